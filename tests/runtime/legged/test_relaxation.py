# SPDX-License-Identifier: Apache-2.0
"""The QP between plan and torques keeps the base's equations of motion and the friction of the ground."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.legged.relaxation import RelaxationConfig, relax, relaxation_problem
from runtime.models.rotations import aligned_with_plane
from runtime.optimization.qp import Daqp, Proxqp, QpSolution

CONFIG = RelaxationConfig()
SEEDS = st.integers(0, 2**32 - 1)


class Answer(NamedTuple):
    """Forces (n, 3) in odom, the acceleration given up, and how good they are."""

    force: np.ndarray
    delta_b: np.ndarray
    solved: bool
    residual: float


class Case:
    """A trunk, feet below it, forces planned for them, and accelerations that do not fit."""

    def __init__(self, seed, feet=None, misfit=1.0):
        rng = np.random.default_rng(seed)
        self.feet = feet or int(rng.integers(1, 5))
        root = rng.standard_normal((6, 6))
        self.inertia = np.diag([12.8] * 3 + [0.1, 0.25, 0.3]) + 0.01 * root @ root.T
        arms = rng.uniform(-0.25, 0.25, (self.feet, 3)) - (0, 0, 0.3)
        self.jacobian = np.vstack([np.hstack((np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]])) for x, y, z in arms])
        slope, direction, yaw = rng.uniform(0, 0.4), *rng.uniform(-np.pi, np.pi, 2)
        normal = np.array([np.sin(slope) * np.cos(direction), np.sin(slope) * np.sin(direction), np.cos(slope)])
        self.plane = aligned_with_plane(yaw, normal)
        self.planned = rng.normal(0, 15, (self.feet, 3)) + np.array([0, 0, 125.0 / self.feet])
        self.unbalanced = self.jacobian.T @ self.planned.ravel() + misfit * rng.normal(0, 20, 6)

    def relax(self, config=CONFIG, solver=None):
        arguments = self.inertia, self.unbalanced, self.jacobian, self.planned, self.plane
        problem = relaxation_problem(table_of(config)[0], *arguments)
        answer = relax(config, solver or Daqp(), problem)
        force = answer.force.reshape(-1, 3) @ self.plane.T
        return Answer(force, problem.change @ answer.force - problem.demand, answer.solved, answer.residual)


@given(SEEDS)
def test_the_six_base_rows_hold(seed):
    case = Case(seed)
    answer = case.relax()
    assert answer.solved
    # M (ddq + delta_b) + h = J^T f
    left = case.inertia @ answer.delta_b + case.unbalanced
    np.testing.assert_allclose(left, case.jacobian.T @ answer.force.ravel(), atol=1e-9 * np.abs(case.unbalanced).max())


@given(SEEDS, st.floats(0.1, 1.0), st.floats(1.0, 20.0))
def test_forces_stay_inside_the_friction_cone_of_the_plane(seed, friction, misfit):
    config = RelaxationConfig(friction=friction, force_max_n=120.0)
    answer = Case(seed, misfit=misfit).relax(config)
    assert answer.solved
    force = answer.force @ Case(seed).plane
    assert (np.hypot(force[:, 0], force[:, 1]) <= friction * force[:, 2] + 1e-6).all()
    assert (force[:, 2] >= -1e-6).all()
    assert (force[:, 2] <= 120.0 + 1e-6).all()


@given(SEEDS)
def test_it_is_the_minimum_of_the_whole_problem(seed):
    """Posed anew in delta_f and delta_b, with the base rows as equations, for the other solver."""
    case = Case(seed)
    n = 3 * case.feet
    mu = CONFIG.friction / np.sqrt(2.0)
    weights = np.diag([CONFIG.force_weight] * n + [CONFIG.linear_weight] * 3 + [CONFIG.angular_weight] * 3)
    base = np.hstack((-case.jacobian.T, case.inertia))
    side = np.array([[1, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu], [0, 0, 1], [0, 0, -1]])
    cone = np.kron(np.eye(case.feet), side @ case.plane.T)
    plan = case.planned.ravel()
    rows = np.vstack((base, np.hstack((cone, np.zeros((len(cone), 6))))))
    equal = case.jacobian.T @ plan - case.unbalanced
    bounds = np.tile([0, 0, 0, 0, CONFIG.force_max_n, 0.0], case.feet) - cone @ plan
    free = np.full(n + 6, 1e7)
    low = np.concatenate((-free, equal, np.full(len(cone), -1e7)))
    high = np.concatenate((free, equal, bounds))
    whole = Proxqp().solve(weights, np.zeros(n + 6), rows, low, high)
    answer = case.relax()
    found = np.concatenate((answer.force.ravel() - plan, answer.delta_b))
    assert found @ weights @ found == pytest.approx(2 * whole.cost, rel=1e-5, abs=1e-5)
    np.testing.assert_allclose(answer.force.ravel(), whole.x[:n] + plan, atol=1e-3)


def test_a_plan_that_fits_is_left_alone():
    case = Case(5, feet=4, misfit=0.0)
    case.planned = np.tile(30.0 * case.plane[:, 2], (4, 1))
    case.unbalanced = case.jacobian.T @ case.planned.ravel()
    answer = case.relax()
    np.testing.assert_allclose(answer.force, case.planned, atol=1e-6)
    np.testing.assert_allclose(answer.delta_b, 0.0, atol=1e-6)


class Failing:
    """A solver that never succeeds."""

    def search(self, hessian, gradient, constraints, lower, upper):
        return QpSolution(np.full_like(gradient, np.nan), False, float("inf"), 0, float("nan"))


@given(SEEDS)
def test_without_a_solution_the_plan_is_kept_and_the_base_rows_still_hold(seed):
    case = Case(seed)
    answer = case.relax(solver=Failing())
    assert not answer.solved
    assert answer.residual == np.inf
    np.testing.assert_allclose(answer.force, case.planned, atol=1e-10)
    left = case.inertia @ answer.delta_b + case.unbalanced
    np.testing.assert_allclose(left, case.jacobian.T @ case.planned.ravel(), atol=1e-9 * np.abs(case.unbalanced).max())


def test_what_is_not_finite_is_not_solved():
    case = Case(8, feet=4)
    case.unbalanced[2] = np.nan
    assert not case.relax().solved
