# SPDX-License-Identifier: Apache-2.0
"""Two solvers of different kinds agree, are reproducible to the bit, and never pass off a wrong answer."""

import subprocess
import sys
from pathlib import Path

import daqp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.optimization import qp
from runtime.optimization.qp import RESIDUAL_TOLERANCE, SOLVERS, Daqp, Proxqp, QpSolution, relative_residual

BOTH = pytest.mark.parametrize("solver", [Daqp, Proxqp])


def friction_problem(seed, feet, condition=1e3):
    """A strictly convex QP in the forces of some feet, with pyramids and bounds on the normal force."""
    rng = np.random.default_rng(seed)
    count = 3 * feet
    axes, _ = np.linalg.qr(rng.standard_normal((count, count)))
    hessian = axes @ np.diag(np.geomspace(1.0, condition, count)) @ axes.T
    hessian = 0.5 * (hessian + hessian.T)
    wanted = rng.normal(0.0, 60.0, count) + np.tile([0.0, 0.0, 30.0], feet)
    mu = rng.uniform(0.2, 0.8)
    rows = np.array([[1, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu]])
    low = np.concatenate((np.tile([-200.0, -200.0, 5.0], feet), np.full(4 * feet, -1e9)))
    high = np.concatenate((np.tile([200.0, 200.0, 150.0], feet), np.zeros(4 * feet)))
    return hessian, -hessian @ wanted, np.kron(np.eye(feet), rows), low, high


def cost(problem, x):
    return 0.5 * x @ problem[0] @ x + problem[1] @ x


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_daqp_and_proxqp_find_the_same_minimum(seed, feet):
    problem = friction_problem(seed, feet)
    one, other = Daqp().solve(*problem), Proxqp().solve(*problem)
    assert one.solved
    assert other.solved
    scale = 1.0 + np.abs(one.x).max()
    np.testing.assert_allclose(one.x, other.x, atol=1e-5 * scale)
    assert one.cost == pytest.approx(other.cost, rel=1e-6, abs=1e-6)
    assert one.cost == pytest.approx(cost(problem, one.x), rel=1e-9, abs=1e-6)


@BOTH
@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), feet=st.integers(1, 4))
def test_no_feasible_point_nearby_is_better(solver, seed, feet):
    problem = friction_problem(seed, feet)
    _, _, rows, low, high = problem
    answer = solver().solve(*problem)
    rng = np.random.default_rng(seed + 1)
    inside = np.tile([0.0, 0.0, 50.0], feet)
    for _ in range(50):
        other = answer.x + rng.normal(0.0, 10.0 ** rng.uniform(-3, 2), answer.x.shape)
        # draw the point towards the middle of the cones until it is feasible
        for share in (0.0, 0.1, 0.5, 0.9):
            candidate = (1 - share) * other + share * inside
            values = np.concatenate((candidate, rows @ candidate))
            if (values <= high).all() and (values >= low).all():
                assert cost(problem, candidate) >= answer.cost - 1e-6 * (1.0 + abs(answer.cost))


@BOTH
def test_without_active_constraints_it_is_the_linear_solution(solver):
    hessian, gradient, rows, _, _ = friction_problem(3, 4)
    free = np.full(12 + 16, 1e6)
    answer = solver().solve(hessian, gradient, rows, -free, free)
    np.testing.assert_allclose(answer.x, -np.linalg.solve(hessian, gradient), rtol=1e-6, atol=1e-6)


def disturb_heap(rng, kept):
    """Leave holes of odd sizes, so that the next allocation starts elsewhere."""
    kept.extend(bytearray(int(n)) for n in rng.integers(1, 5000, 20))
    for _ in range(10):
        kept.pop(int(rng.integers(len(kept))))


@BOTH
def test_200_fresh_solvers_on_a_disturbed_heap_give_one_bit_pattern(solver):
    problem, rng, kept = friction_problem(7, 8, condition=1e5), np.random.default_rng(0), []
    patterns = set()
    for index in range(200):
        disturb_heap(rng, kept)
        shift = int(rng.integers(0, 8))  # the data themselves at every alignment to 8 bytes
        copies = []
        for part in problem:
            room = np.empty(part.size + 8)
            copy = room[shift : shift + part.size].reshape(part.shape)
            copy[...] = part
            copies.append(copy)
        answer = solver().solve(*copies)
        assert answer.solved, index
        patterns.add((answer.x.tobytes(), answer.iterations, answer.cost))
    assert len(patterns) == 1


@BOTH
def test_a_solver_remembers_nothing(solver):
    fresh = solver().solve(*friction_problem(1, 4))
    used = solver()
    for seed in range(2, 20):
        used.solve(*friction_problem(seed, seed % 5 + 1))
    assert used.solve(*friction_problem(1, 4)).x.tobytes() == fresh.x.tobytes()


_ONE_SOLVE = """
import sys
import numpy as np
sys.path[:0] = sys.argv[1:]
from runtime.optimization.qp import Proxqp, _proxsuite_baseline
before = set(sys.modules)
answer = Proxqp().solve(np.eye(3), np.ones(3), np.ones((1, 3)), -np.ones(4), np.ones(4))
new = sorted(name for name in set(sys.modules) - before if "prox" in name)
print(answer.x.tobytes().hex(), new, _proxsuite_baseline().__file__)
"""


def test_proxqp_is_the_baseline_build_and_loads_no_other():
    root = str(Path(qp.__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-c", _ONE_SOLVE, root], capture_output=True, text=True, check=True, timeout=60
    )
    bits, new, file = done.stdout.strip().split(" ", 2)[0], done.stdout, done.stdout.split()[-1]
    assert np.frombuffer(bytes.fromhex(bits)).tolist() == pytest.approx([-1.0 / 3.0] * 3)
    assert "avx" not in new.lower()
    assert "'proxsuite'" not in new
    assert "proxsuite_pywrap." in file


@BOTH
def test_contradicting_constraints_are_not_solved(solver):
    rows = np.array([[1.0, 0.0], [1.0, 0.0]])
    low, high = np.array([-9.0, -9.0, 2.0, -9.0]), np.array([9.0, 9.0, 9.0, 1.0])
    assert not solver().solve(np.eye(2), np.zeros(2), rows, low, high).solved


@BOTH
def test_crossed_bounds_are_not_solved(solver):
    low, high = np.array([2.0, -1.0, -9.0]), np.array([1.0, 1.0, 9.0])
    assert not solver().solve(np.eye(2), np.zeros(2), np.ones((1, 2)), low, high).solved


@BOTH
@pytest.mark.parametrize("part", [0, 1])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_not_solved(solver, part, value):
    problem = [array.copy() for array in friction_problem(5, 2)]
    problem[part].flat[4] = value
    answer = solver().solve(*problem)
    assert not answer.solved
    assert answer.residual == np.inf


@BOTH
def test_an_iteration_limit_that_is_too_low_is_not_a_solution(solver):
    problem = friction_problem(11, 12)
    assert solver().solve(*problem).solved
    assert not solver(1).solve(*problem).solved


def exact(seed=5, feet=2):
    """A problem, its minimiser and its multipliers."""
    problem = friction_problem(seed, feet)
    hessian, gradient, rows, low, high = problem
    x = Daqp().solve(*problem).x
    stacked = np.vstack((np.eye(len(x)), rows))
    values = stacked @ x
    active = (values > high - 1e-7) | (values < low + 1e-7)
    multipliers = np.zeros(len(values))
    multipliers[active] = np.linalg.lstsq(stacked[active].T, -(hessian @ x + gradient), rcond=None)[0]
    return problem, x, multipliers


def test_the_residual_of_the_minimum_is_nil():
    problem, x, multipliers = exact()
    assert np.count_nonzero(multipliers) >= 2
    assert relative_residual(x, multipliers, *problem) < 1e-9


@given(st.integers(0, 5), st.floats(1e-2, 1e3), st.sampled_from([-1.0, 1.0]))
def test_the_residual_catches_a_wrong_point(index, size, sign):
    problem, x, multipliers = exact()
    wrong = x.copy()
    wrong[index] += sign * size
    assert relative_residual(wrong, multipliers, *problem) > RESIDUAL_TOLERANCE


def test_the_residual_catches_a_point_outside():
    problem, x, _ = exact()
    unconstrained = -np.linalg.solve(problem[0], problem[1])
    assert relative_residual(unconstrained, np.zeros(len(x) + len(problem[2])), *problem) > RESIDUAL_TOLERANCE


@pytest.mark.parametrize("argument", range(7))
def test_the_residual_of_anything_not_finite_is_infinite(argument):
    problem, x, multipliers = exact()
    parts = [x.copy(), multipliers.copy(), *(array.copy() for array in problem)]
    parts[argument].flat[0] = np.nan
    assert relative_residual(*parts) == np.inf


def test_the_residual_catches_multipliers_of_the_wrong_sign():
    # x = 0 with a gradient of 1 is held by the lower bound only; said to be held by the upper one, it is no minimum
    hessian, gradient = np.eye(1), np.array([-1.0])
    rows, low, high = np.zeros((1, 1)), np.array([0.0, -1.0]), np.array([5.0, 1.0])
    assert relative_residual(np.zeros(1), np.array([1.0, 0.0]), hessian, gradient, rows, low, high) > RESIDUAL_TOLERANCE


def test_the_residual_catches_a_multiplier_of_a_bound_that_is_not_reached():
    # stationary and feasible in the middle of its range, held there by a bound 2 away
    hessian, gradient, rows = np.eye(1), np.array([-1.0]), np.zeros((1, 1))
    bounds = np.array([-5.0, -1.0]), np.array([2.0, 1.0])
    assert relative_residual(np.zeros(1), np.array([1.0, 0.0]), hessian, gradient, rows, *bounds) > 0.1
    assert relative_residual(np.ones(1), np.zeros(2), hessian, gradient, rows, *bounds) < 1e-12


def test_the_residual_takes_bounds_that_are_infinite():
    hessian, gradient, rows = np.eye(1), np.array([-1.0]), np.zeros((1, 1))
    bounds = np.array([-np.inf, -np.inf]), np.array([5.0, np.inf])
    assert relative_residual(np.ones(1), np.zeros(2), hessian, gradient, rows, *bounds) < 1e-12


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(-7.0, 3.0))
def test_proxqp_finds_the_minimum_at_any_scale_of_the_objective(seed, exponent):
    hessian, gradient, *rest = friction_problem(seed, 3)
    plain, scale = Daqp().solve(hessian, gradient, *rest), 10.0**exponent
    scaled = Proxqp().solve(scale * hessian, scale * gradient, *rest)
    assert plain.solved
    assert scaled.solved
    np.testing.assert_allclose(scaled.x, plain.x, atol=1e-4 * (1.0 + np.abs(plain.x).max()))
    assert scaled.cost == pytest.approx(scale * plain.cost, rel=1e-5, abs=1e-5 * scale)


def test_a_solver_that_claims_success_for_a_wrong_answer_is_found_out(monkeypatch):
    def lie(hessian, gradient, *rest, **options):
        x, cost, _, info = real(hessian, gradient, *rest, **options)
        return x + 0.1, cost, 1, info

    real = daqp.solve
    problem = friction_problem(9, 4)
    assert Daqp().solve(*problem).solved
    monkeypatch.setattr(daqp, "solve", lie)
    answer = Daqp().solve(*problem)
    assert not answer.solved
    assert answer.residual > RESIDUAL_TOLERANCE


def test_solvers_are_named_as_in_the_configuration():
    assert set(SOLVERS) == {"daqp", "proxqp"}
    for kind in SOLVERS.values():
        assert isinstance(kind().solve(np.eye(1), np.ones(1), np.ones((1, 1)), -np.ones(2), np.ones(2)), QpSolution)
