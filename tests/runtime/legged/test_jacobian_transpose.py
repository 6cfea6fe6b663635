# SPDX-License-Identifier: Apache-2.0
"""The control law without whole-body control: J^T f below, Cartesian PD above, and the drives' own damping."""

import numpy as np
import pytest

from runtime.legged.jacobian_transpose import JacobianTransposeConfig, JacobianTransposeLaw
from runtime.models.leg_kinematics import LegKinematics

NOW_NS = 1_000_000_000
CONFIG = JacobianTransposeConfig()


def law(robot):
    return JacobianTransposeLaw(robot.robot, CONFIG, robot.body, robot.joints, robot.gait, robot.forces, robot.output)


def legs_of(robot):
    return LegKinematics(robot.robot).forward(robot.joints.position, robot.joints.velocity)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_standing_legs_press_with_the_planned_forces(bench, yaw):
    robot = bench(yaw)
    force = robot.balanced(NOW_NS)
    assert law(robot).command(NOW_NS)
    for leg, jacobian in enumerate(legs_of(robot).jacobian):
        pressed = np.linalg.solve(jacobian.T, robot.output.effort[3 * leg : 3 * leg + 3])
        np.testing.assert_allclose(pressed, -(force[leg] @ robot.rotation), atol=1e-9)


def test_a_leg_in_the_air_is_pulled_to_its_reference(bench):
    robot = bench()
    robot.balanced(NOW_NS)
    robot.gait.contact = (False, True, True, True)
    robot.gait.swing_position = robot.feet.ravel()
    robot.gait.swing_position[:3] += (0.02, 0.0, 0.03)
    law(robot).command(NOW_NS)
    pulled = np.linalg.solve(legs_of(robot).jacobian[0].T, robot.output.effort[:3])
    np.testing.assert_allclose(pulled, CONFIG.swing_stiffness_n_pm * np.array([0.02, 0.0, 0.03]), atol=1e-6)


def test_the_drives_are_given_rates_that_keep_standing_feet_at_rest_under_a_moving_trunk(bench):
    robot = bench(0.4, velocity=(0.3, -0.2, 0.1))
    robot.body.angular_velocity = (0.2, -0.1, 0.5)
    robot.balanced(NOW_NS)
    law(robot).command(NOW_NS)
    legs = legs_of(robot)
    turning = np.cross(robot.body.angular_velocity, legs.position)
    relative = np.einsum("lij,lj->li", legs.jacobian, robot.output.velocity.reshape(4, 3))
    moving = robot.body.linear_velocity + (turning + relative) @ robot.rotation.T
    assert np.abs(moving).max() < 0.01  # the inverse is damped


def test_standing_and_flying_legs_are_damped_differently(bench):
    robot = bench()
    robot.balanced(NOW_NS)
    robot.gait.contact = (True, False, True, False)
    law(robot).command(NOW_NS)
    standing, flying = CONFIG.stance_joint_damping_nms_prad, CONFIG.swing_joint_damping_nms_prad
    assert robot.output.damping.tolist() == [standing] * 3 + [flying] * 3 + [standing] * 3 + [flying] * 3
    assert not robot.output.stiffness.any()
