# SPDX-License-Identifier: Apache-2.0
"""The condensed problem against a simulation of the same linear model, and what its optimum must satisfy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.legged.mpc import Horizon, MpcConfig, TrunkMpc
from runtime.models.rotations import aligned_with_plane
from runtime.optimization.qp import Daqp, Proxqp

CONFIG = MpcConfig()
WEIGHTS = np.concatenate(
    (CONFIG.orientation_weight, CONFIG.position_weight, CONFIG.angular_velocity_weight, CONFIG.velocity_weight)
)
INERTIA = np.array([[0.12, 0.0, 0.01], [0.0, 0.35, 0.0], [0.01, 0.0, 0.4]])
MASS, G = 12.786, 9.81
FEET = np.array([[0.18, 0.122, -0.29], [0.18, -0.122, -0.29], [-0.18, 0.122, -0.29], [-0.18, -0.122, -0.29]])
SEEDS = st.integers(0, 2**32 - 1)
MIRROR = np.array([1.0, -1.0, 1.0])


def trot(steps, first=0):
    pair = np.array([[1, 0, 0, 1], [0, 1, 1, 0]], bool)
    return pair[((np.arange(steps) + first) // (steps // 2)) % 2]


def wild(seed, steps=10):
    """A horizon with uneven steps, moving footholds, a curved reference and any contacts."""
    rng = np.random.default_rng(seed)
    normal = np.array([*rng.uniform(-0.35, 0.35, 2), 1.0])
    yaw = rng.uniform(-np.pi, np.pi)
    state = np.concatenate((rng.uniform(-0.2, 0.2, 2), [yaw], rng.uniform(-2, 2, 3), rng.uniform(-1, 1, 6)))
    reference = state + rng.uniform(-0.3, 0.3, (steps, 12))
    reference[:, 2] = yaw + np.cumsum(rng.uniform(-0.1, 0.1, steps))
    stance = rng.random((steps, 4)) < 0.6
    stance[rng.integers(steps), rng.integers(4)] = True
    lever = FEET + rng.uniform(-0.08, 0.08, (steps, 4, 3))
    plane = aligned_with_plane(yaw, normal / np.linalg.norm(normal))
    durations = rng.uniform(0.002, 0.05, steps)
    return Horizon(state, reference, durations, stance, lever, plane, INERTIA, MASS)


def standing(steps=10, **changes):
    state = np.zeros(12)
    state[5] = 0.29
    parts = {
        "state": state,
        "reference": np.tile(state, (steps, 1)),
        "durations": np.full(steps, 0.04),
        "stance": np.ones((steps, 4), bool),
        "lever": np.tile(FEET, (steps, 1, 1)),
        "plane": np.eye(3),
        "inertia": INERTIA,
        "mass": MASS,
    }
    return Horizon(**{**parts, **changes})


def simulated_cost(horizon, force):
    """Integrate the model step by step under forces (N, 4, 3) in odom, exactly for constant force; sum the cost."""
    state = horizon.state.copy()
    spin = rotation(horizon.state[2])
    inertia = spin @ horizon.inertia @ spin.T
    total = 0.0
    for step, dt in enumerate(horizon.durations):
        yaw = horizon.state[2] if step == 0 else horizon.reference[step - 1, 2]
        turn = rotation(yaw).T
        moment, push = np.zeros(3), np.zeros(3)
        for foot in range(4):
            if horizon.stance[step, foot]:
                moment += np.cross(horizon.lever[step, foot], force[step, foot])
                push += force[step, foot]
        angular = np.linalg.solve(inertia, moment)
        linear = push / horizon.mass - (0.0, 0.0, G)
        state[0:3] += turn @ (dt * state[6:9] + 0.5 * dt**2 * angular)
        state[3:6] += dt * state[9:12] + 0.5 * dt**2 * linear
        state[6:9] += dt * angular
        state[9:12] += dt * linear
        away = state - horizon.reference[step]
        total += 0.5 * away @ (WEIGHTS * away)
        total += 0.5 * CONFIG.force_weight * np.square(force[step][horizon.stance[step]]).sum()
    return total


def rotation(yaw):
    return np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])


@settings(max_examples=40)
@given(SEEDS, st.sampled_from([4, 10, 16]))
def test_the_condensed_cost_is_that_of_the_simulated_model(seed, steps):
    horizon = wild(seed, steps)
    problem = TrunkMpc(CONFIG, Daqp()).condense(horizon)
    rng = np.random.default_rng(seed + 1)
    nothing = simulated_cost(horizon, np.zeros((steps, 4, 3)))
    for _ in range(3):
        u = rng.normal(0, 60, problem.gradient.shape)
        force = np.zeros((steps, 4, 3))
        force[problem.slots] = u.reshape(-1, 3) @ horizon.plane.T
        condensed = 0.5 * u @ problem.hessian @ u + problem.gradient @ u
        assert condensed + nothing == pytest.approx(simulated_cost(horizon, force), rel=1e-9)


@given(SEEDS)
def test_swing_feet_are_not_variables(seed):
    horizon = wild(seed)
    problem = TrunkMpc(CONFIG, Daqp()).condense(horizon)
    assert problem.gradient.shape == (3 * horizon.stance.sum(),)
    assert np.linalg.eigvalsh(problem.hessian).min() > 0.0
    plan = TrunkMpc(CONFIG, Daqp()).plan(horizon)
    assert plan.solved
    assert not plan.force[~horizon.stance].any()


@settings(max_examples=15)
@given(SEEDS)
def test_both_solvers_give_the_same_plan(seed):
    horizon = wild(seed)
    one, other = (TrunkMpc(CONFIG, solver()).plan(horizon) for solver in (Daqp, Proxqp))
    assert (one.solved, other.solved) == (True, True)
    assert one.cost == pytest.approx(other.cost, rel=1e-6, abs=1e-6)
    # the force weight of 1e-5 leaves the internal forces loosely determined
    np.testing.assert_allclose(one.force, other.force, atol=0.05)


@settings(max_examples=15)
@given(SEEDS)
def test_proxqp_at_a_scale_of_its_own_finds_the_same_plan(seed):
    """The objective times 1000, so that proxqp's absolute thresholds fit: an independent optimum for every horizon."""
    horizon = wild(seed)
    mpc = TrunkMpc(CONFIG, Daqp())
    problem, plan = mpc.condense(horizon), mpc.plan(horizon)
    scaled = Proxqp(accuracy=1e-6).solve(1e3 * problem.hessian, 1e3 * problem.gradient, *problem[2:5])
    assert plan.solved
    assert scaled.solved
    assert 1e-3 * scaled.cost == pytest.approx(plan.cost, rel=1e-6, abs=1e-6)
    np.testing.assert_allclose(plan.force[problem.slots], scaled.x.reshape(-1, 3) @ horizon.plane.T, atol=0.05)


@settings(max_examples=15)
@given(SEEDS)
def test_no_admissible_change_of_the_plan_is_better(seed):
    horizon = wild(seed)
    plan, rng = TrunkMpc(CONFIG, Daqp()).plan(horizon), np.random.default_rng(seed)
    best = simulated_cost(horizon, plan.force)
    middle = np.zeros_like(plan.force)
    middle[horizon.stance] = 80.0 * horizon.plane[:, 2]
    for share in (1e-3, 1e-2, 0.3):
        other = (1 - share) * plan.force + share * middle * rng.uniform(0.2, 1.0)
        assert simulated_cost(horizon, other) >= best - 1e-9 * (1 + best)


@settings(max_examples=30)
@given(SEEDS)
def test_friction_and_load_bounds_hold_in_the_planes_own_axes(seed):
    horizon = wild(seed)
    plan = TrunkMpc(CONFIG, Daqp()).plan(horizon)
    force = plan.force[horizon.stance] @ horizon.plane
    bound = CONFIG.friction / np.sqrt(2.0) * force[:, 2] + 1e-6
    assert (np.abs(force[:, 0]) <= bound).all()
    assert (np.abs(force[:, 1]) <= bound).all()
    # and so inside the true cone about the plane's normal
    assert (np.hypot(force[:, 0], force[:, 1]) <= CONFIG.friction * force[:, 2] + 1e-5).all()
    assert (force[:, 2] >= CONFIG.force_min_n - 1e-6).all()
    assert (force[:, 2] <= CONFIG.force_max_n + 1e-6).all()


@pytest.mark.parametrize("stance", [np.ones((10, 4), bool), trot(10)], ids=["standing", "trotting"])
def test_forces_carry_the_weight(stance):
    plan = TrunkMpc(CONFIG, Daqp()).plan(standing(stance=stance))
    total = plan.force.sum(axis=1)
    # the last steps have little left to gain from it
    np.testing.assert_allclose(total[:7, 2], MASS * G, rtol=0.01)
    np.testing.assert_allclose(total[:7, :2], 0.0, atol=0.01 * MASS * G)
    moment = np.cross(FEET, plan.force).sum(axis=1)
    np.testing.assert_allclose(moment[:7], 0.0, atol=0.2)


@pytest.mark.parametrize("degrees", [15, 20, 25])
def test_on_a_slope_the_weight_is_carried_without_leaving_the_cone(degrees):
    angle = np.radians(degrees)
    normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    plane = aligned_with_plane(0.0, normal)
    state = np.zeros(12)
    state[1] = -angle
    horizon = standing(
        plane=plane, lever=np.tile(FEET @ plane.T, (10, 1, 1)), state=state, reference=np.tile(state, (10, 1))
    )
    plan = TrunkMpc(MpcConfig(friction=0.8), Daqp()).plan(horizon)
    np.testing.assert_allclose(plan.force[:7].sum(axis=1), np.tile((0, 0, MASS * G), (7, 1)), atol=0.02 * MASS * G)
    in_plane = plan.force @ plane
    assert (np.hypot(in_plane[..., 0], in_plane[..., 1]) <= 0.8 * in_plane[..., 2] + 1e-6).all()


@settings(max_examples=20)
@given(SEEDS)
def test_a_mirrored_robot_gets_mirrored_forces(seed):
    rng = np.random.default_rng(seed)
    state = np.concatenate((rng.uniform(-0.1, 0.1, 6), rng.uniform(-0.5, 0.5, 6)))
    state[2] = rng.uniform(-1.0, 1.0)
    turning = np.concatenate(([-1, 1, -1], MIRROR, [-1, 1, -1], MIRROR))
    reference = np.zeros((10, 12)) + rng.uniform(-0.2, 0.2, 12)
    lever = np.tile(FEET, (10, 1, 1)) + rng.uniform(-0.03, 0.03, (10, 4, 3))
    one = standing(stance=trot(10), state=state, reference=reference, lever=lever)
    swap = [1, 0, 3, 2]
    other = standing(
        stance=trot(10)[:, swap],
        state=state * turning,
        reference=reference * turning,
        lever=lever[:, swap] * MIRROR,
    )
    plans = [TrunkMpc(CONFIG, Daqp()).plan(horizon) for horizon in (one, other)]
    np.testing.assert_allclose(plans[1].force, plans[0].force[:, swap] * MIRROR, atol=1e-3)
    assert plans[1].cost == pytest.approx(plans[0].cost, rel=1e-9)


@settings(max_examples=10)
@given(SEEDS, st.floats(-3.0, 3.0))
def test_a_turned_world_turns_the_forces(seed, yaw):
    """Nothing depends on where north is; the pyramid's axes and the weights turn along only for isotropic weights."""
    config = MpcConfig(
        orientation_weight=(5, 5, 5), angular_velocity_weight=(0.1, 0.1, 0.1), position_weight=(20, 20, 20)
    )
    horizon = wild(seed)
    turn = rotation(yaw)

    def turned(state):
        # the angles are a body matter but for the yaw: the model's T_z turns with it
        blocks = [state[..., :3] + (0, 0, yaw), *(state[..., i : i + 3] @ turn.T for i in (3, 6, 9))]
        return np.concatenate(blocks, axis=-1)

    other = horizon._replace(
        state=turned(horizon.state),
        reference=turned(horizon.reference),
        lever=horizon.lever @ turn.T,
        plane=turn @ horizon.plane,
    )
    plans = [TrunkMpc(config, Daqp()).plan(h) for h in (horizon, other)]
    np.testing.assert_allclose(plans[1].force, plans[0].force @ turn.T, atol=0.02)


def test_contradicting_load_bounds_are_not_solved():
    config = MpcConfig(force_min_n=80.0, force_max_n=40.0)
    plan = TrunkMpc(config, Daqp()).plan(standing())
    assert not plan.solved
    assert not plan.force.any()


@pytest.mark.parametrize("part", ["state", "reference", "lever"])
def test_what_is_not_finite_is_not_solved(part):
    horizon = standing()
    getattr(horizon, part).flat[5] = np.nan
    plan = TrunkMpc(CONFIG, Daqp()).plan(horizon)
    assert not plan.solved
    assert not plan.force.any()


def test_the_same_horizon_gives_the_same_bits():
    horizon = wild(4)
    plans = {TrunkMpc(CONFIG, Daqp()).plan(horizon).force.tobytes() for _ in range(20)}
    assert len(plans) == 1
