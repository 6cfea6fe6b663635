# SPDX-License-Identifier: Apache-2.0
"""The MPC as a task: latency predicted over, the last good plan held, bad numbers survived."""

import numpy as np
import pytest

from runtime.legged.mpc_task import MpcTask
from runtime.models.rigid_body import GRAVITY
from runtime.optimization.qp import Daqp, QpSolution

MS = 1_000_000


class Switchable(Daqp):
    """A solver that can be made to fail."""

    failing = False

    def solve(self, *arguments, **options):
        answer = super().solve(*arguments, **options)
        if self.failing:
            return QpSolution(answer.x * np.nan, False, float("inf"), 7, float("nan"))
        return answer


def task(bench, solver=None):
    config = bench.config
    return MpcTask(
        config.quadruped,
        config.mpc,
        config.gait,
        config.posture,
        solver or Switchable(),
        10 * MS,
        20 * MS,
        bench.body,
        bench.joints,
        bench.command,
        bench.gait,
        bench.forces,
    )


def forces_of(bench):
    return bench.forces.force.reshape(-1, 4, 3)


def test_standing_the_plan_carries_the_weight_on_the_average_of_its_horizon(bench):
    robot = bench(yaw=0.7)
    task(robot).step(1000 * MS)
    durations = np.diff(robot.forces.knot_ns)
    weight = robot.robot.mass_kg * GRAVITY
    impulse = durations @ forces_of(robot).sum(axis=1) / durations.sum()
    # the first plan predicts its latency by equal shares, which tip the trunk a little: 3 % instead of 1 %
    np.testing.assert_allclose(impulse, (0.0, 0.0, weight), atol=0.03 * weight)


def test_the_plan_begins_when_its_budget_has_passed(bench):
    robot = bench()
    robot.gait.cycle_start_ns = 950 * MS
    task(robot).step(1000 * MS)
    assert robot.forces.stamp_ns == robot.forces.knot_ns[0] == 1010 * MS
    assert (np.diff(robot.forces.knot_ns) > 0).all()


def test_the_latency_is_predicted_over(bench):
    robot = bench(velocity=(0.3, -0.1, 0.0))
    task(robot).step(1000 * MS)
    # a new reference begins where the plan finds the robot, 10 ms later
    ahead = robot.model().center_of_mass + 0.01 * robot.body.linear_velocity
    np.testing.assert_allclose(robot.forces.reference_position[:2], ahead[:2], atol=2e-4)


def test_a_plan_that_failed_leaves_the_last_good_one_and_is_counted(bench):
    robot, solver = bench(), Switchable()
    mpc = task(robot, solver)
    robot.gait.walking = True
    robot.command.velocity = (0.6, 0.0)
    mpc.step(1000 * MS)
    good = robot.forces.like()
    good.copy_from(robot.forces)
    solver.failing = True
    for count in (1, 2, 3):
        mpc.step((1000 + 20 * count) * MS)
        assert robot.forces.failures == mpc.state.failures == count
        for name in ("stamp_ns", "knot_ns", "stance", "force", "cost"):
            np.testing.assert_array_equal(getattr(robot.forces, name), getattr(good, name))
    solver.failing = False
    mpc.step(1080 * MS)
    assert robot.forces.stamp_ns == 1090 * MS
    assert robot.forces.failures == 3


def test_the_references_of_a_held_plan_are_those_of_its_stamp(bench):
    robot, solver = bench(), Switchable()
    mpc = task(robot, solver)
    robot.gait.walking = True
    robot.command.velocity = (0.6, 0.0)
    mpc.step(1000 * MS)
    held = robot.forces.reference_position.copy()
    solver.failing = True
    for count in range(1, 4):
        mpc.step((1000 + 20 * count) * MS)
    # the whole-body control adds velocity times the age of the stamp to it
    np.testing.assert_array_equal(robot.forces.reference_position, held)


@pytest.mark.parametrize("field", ["position", "linear_velocity", "orientation"])
def test_a_state_that_is_not_finite_is_a_failure_and_passes_with_it(bench, field):
    robot, restarted = bench(), bench()
    mpc, other = task(robot), task(restarted)
    mpc.step(1000 * MS)
    other.step(1000 * MS)
    before = robot.forces.force.copy()
    kept = getattr(robot.body, field).copy()
    getattr(robot.body, field)[0] = np.nan
    mpc.step(1020 * MS)
    assert robot.forces.failures == 1
    np.testing.assert_array_equal(robot.forces.force, before)
    setattr(robot.body, field, kept)
    mpc.step(1040 * MS)
    assert robot.forces.failures == 1
    assert np.isfinite([*mpc.state.reference_xy, mpc.state.reference_yaw]).all()
    # as if the legs had not carried in between: a new reference from the present state
    restarted.gait.balancing = False
    other.step(1020 * MS)
    restarted.gait.balancing = True
    other.step(1040 * MS)
    np.testing.assert_array_equal(robot.forces.force, restarted.forces.force)
    np.testing.assert_array_equal(robot.forces.reference_position, restarted.forces.reference_position)


def test_it_waits_for_an_estimate_and_for_legs_that_carry(bench):
    robot = bench()
    mpc = task(robot)
    robot.gait.balancing = False
    mpc.step(1000 * MS)
    robot.gait.balancing, robot.body.stamp_ns = True, 0
    mpc.step(1020 * MS)
    assert robot.forces.stamp_ns == 0
    robot.body.stamp_ns = 1
    mpc.step(1040 * MS)
    assert robot.forces.stamp_ns == 1050 * MS


def test_the_position_reference_does_not_run_away_from_a_robot_that_is_held(bench):
    robot = bench()
    mpc = task(robot)
    robot.gait.walking = True
    robot.command.velocity = (0.6, 0.0)
    for tick in range(100):
        mpc.step((1000 + 20 * tick) * MS)
    center = robot.model().center_of_mass
    away = np.hypot(*(robot.forces.reference_position[:2] - center[:2]))
    assert away == pytest.approx(robot.config.mpc.position_clamp_m, abs=1e-3)


def yaw_moment_after_a_turn(bench, yaw):
    robot = bench(yaw)
    mpc = task(robot)
    mpc.step(1000 * MS)
    turned = bench(yaw + 0.1)
    robot.body.orientation, robot.body.foot_position = turned.body.orientation, turned.body.foot_position
    robot.gait.foothold = turned.gait.foothold
    mpc.step(1020 * MS)
    return np.cross(turned.feet - turned.model().center_of_mass, forces_of(robot)[0]).sum(axis=0)[2]


@pytest.mark.parametrize("yaw", [np.pi - 0.05, -np.pi + 0.05, np.pi, 2.0, -1.0])
def test_heading_is_corrected_alike_in_every_direction_and_across_the_seam(bench, yaw):
    expected = yaw_moment_after_a_turn(bench, 0.0)
    assert -15.0 < expected < -1.0
    assert yaw_moment_after_a_turn(bench, yaw) == pytest.approx(expected, rel=1e-3)


def test_saved_and_restored_it_plans_the_same(bench):
    robot, other = bench(), bench()
    one, two = task(robot), task(other)
    for now in range(1000, 1100, 20):
        one.step(now * MS)
        two.restore(two.save())
        two.step(now * MS)
    assert robot.forces.to_bytes() == other.forces.to_bytes()


@pytest.mark.parametrize(("gap_ms", "counted_ms"), [(20, 20), (60, 60), (100, 100), (2000, 100)])
def test_the_reference_moves_on_by_the_time_since_the_last_plan(bench, gap_ms, counted_ms):
    robot = bench()
    mpc = task(robot)
    robot.gait.walking, robot.command.velocity = True, (0.3, 0.0)
    mpc.step(1000 * MS)
    before = mpc.state.reference_xy[0]
    mpc.step((1000 + gap_ms) * MS)
    assert mpc.state.reference_xy[0] - before == pytest.approx(0.3 * counted_ms * 1e-3, abs=1e-9)
