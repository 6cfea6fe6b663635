# SPDX-License-Identifier: Apache-2.0
"""Which plan the control law is given: the other loop's, or in its place one of standing."""

import numpy as np
import pytest

from runtime.legged.locomotion_task import LocomotionTask
from runtime.legged.whole_body import WholeBodyLaw
from runtime.models.rigid_body import GRAVITY
from runtime.optimization.qp import SOLVERS

MS = 1_000_000
AGE_NS = 200 * MS


class Rig:
    """A standing robot with a plan of 1 s."""

    def __init__(self, robot):
        self.robot = robot
        self.now_ns = 1000 * MS
        robot.balanced(self.now_ns)
        config = robot.config
        self.plan = robot.forces.like()
        records = robot.body, robot.joints, robot.gait, self.plan, robot.output
        law = WholeBodyLaw(robot.robot, config.whole_body, SOLVERS["daqp"](), *records)
        self.task = LocomotionTask(
            config.posture,
            law,
            robot.robot.mass_kg,
            AGE_NS,
            robot.posture,
            robot.gait,
            robot.body,
            robot.forces,
            self.plan,
            robot.output,
        )

    def step(self, age_ns=0):
        self.task.step(self.robot.forces.stamp_ns + age_ns)


@pytest.mark.parametrize("age_ns", [0, AGE_NS])
def test_a_plan_within_its_age_is_passed_on_as_it_is(bench, age_ns):
    rig = Rig(bench())
    rig.step(age_ns)
    assert rig.plan.to_bytes() == rig.robot.forces.to_bytes()


def test_a_walking_robot_holds_the_last_plan(bench):
    rig = Rig(bench())
    rig.robot.gait.walking = True
    rig.step(3 * AGE_NS)
    assert rig.plan.to_bytes() == rig.robot.forces.to_bytes()


def test_a_standing_robot_without_a_plan_shares_its_weight_and_stays_where_it_is(bench):
    rig = Rig(bench(yaw=0.7))
    rig.robot.forces.reference_velocity = (0.6, 0.0, 0.0)
    rig.robot.forces.reference_yaw_rate = 0.5
    rig.step(AGE_NS + 1)
    forces = rig.plan.force.reshape(-1, 4, 3)
    np.testing.assert_allclose(forces.sum(axis=1), [(0.0, 0.0, rig.robot.robot.mass_kg * GRAVITY)] * len(forces))
    np.testing.assert_allclose(rig.plan.reference_position[:2], rig.robot.feet.mean(axis=0)[:2])
    assert rig.plan.reference_position[2] == rig.robot.forces.reference_position[2]
    assert rig.plan.reference_orientation[2] == pytest.approx(0.7)
    assert not rig.plan.reference_velocity.any()
    assert rig.plan.reference_yaw_rate == 0.0
    place = rig.plan.reference_position.copy()
    rig.robot.body.foot_position = rig.robot.body.foot_position + 0.05
    rig.step(2 * AGE_NS)
    np.testing.assert_array_equal(rig.plan.reference_position, place)


def test_a_new_plan_is_taken_up_at_once(bench):
    rig = Rig(bench())
    rig.step(2 * AGE_NS)
    rig.robot.balanced(rig.now_ns + 3 * AGE_NS)
    rig.step()
    assert rig.plan.to_bytes() == rig.robot.forces.to_bytes()


def test_the_commands_of_both_plans_carry_a_resting_robot_alike(bench):
    rig = Rig(bench())
    rig.step()
    planned = rig.robot.output.effort.copy()
    rig.step(AGE_NS + 1)
    np.testing.assert_allclose(rig.robot.output.effort, planned, atol=1.0)
