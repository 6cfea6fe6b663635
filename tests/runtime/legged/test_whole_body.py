# SPDX-License-Identifier: Apache-2.0
"""Joint commands: gravity compensation at rest, the equations of motion always, tasks in their order."""

import numpy as np
import pytest

from runtime.legged.jacobian_transpose import JacobianTransposeLaw
from runtime.legged.whole_body import WholeBodyLaw, planned_force
from runtime.models.leg_kinematics import LegKinematics
from runtime.models.quadruped import AXES, LEFT
from runtime.models.rigid_body import GRAVITY
from runtime.optimization.qp import Daqp

MS = 1_000_000
NOW = 1000 * MS


def law(robot):
    records = robot.body, robot.joints, robot.gait, robot.forces, robot.output
    return WholeBodyLaw(robot.robot, robot.config.whole_body, Daqp(), *records)


def plain(robot):
    records = robot.body, robot.joints, robot.gait, robot.forces, robot.output
    return JacobianTransposeLaw(robot.robot, robot.config.jacobian_transpose, *records)


def leg_weight_torque(robot):
    """What holds the links of the legs against gravity: the gradient of their potential energy, by differences."""
    shape = robot.robot

    def energy(angles):
        total = 0.0
        for leg in range(4):
            q = angles[3 * leg : 3 * leg + 3]
            place, turn = shape.hip_positions()[leg], np.eye(3)
            offsets = ((0, 0, 0), (0, LEFT[leg] * shape.abad_length_m, 0), (0, 0, -shape.thigh_length_m))
            for joint, link in enumerate((shape.abad, shape.thigh, shape.shank)):
                place = place + turn @ offsets[joint]
                turn = turn @ rotated(AXES[joint], q[joint])
                total += link.mass_kg * GRAVITY * (place + turn @ link.center(LEFT[leg]))[2]
        return total

    at, step = np.array(robot.joints.position), 1e-6
    return np.array([(energy(at + step * e) - energy(at - step * e)) / (2 * step) for e in np.eye(12)])


def rotated(axis, angle):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_standing_still_the_torques_are_gravity_compensation(bench, yaw):
    robot = bench(yaw)
    force = robot.balanced(NOW)
    assert law(robot).command(NOW)
    legs = LegKinematics(robot.robot).forward(robot.joints.position, np.zeros(12))
    carried = -np.einsum("lij,li->lj", legs.jacobian, force @ robot.rotation).ravel()
    np.testing.assert_allclose(robot.output.effort, carried + leg_weight_torque(robot), atol=1e-4)
    np.testing.assert_allclose(robot.output.position, robot.joints.position, atol=1e-6)
    np.testing.assert_allclose(robot.output.velocity, 0.0, atol=1e-6)
    np.testing.assert_allclose(robot.output.relaxation, 0.0, atol=1e-4)


def test_without_whole_body_control_the_torques_are_the_transposed_jacobian_alone(bench):
    robot = bench(1.0)
    force = robot.balanced(NOW)
    plain(robot).command(NOW)
    legs = LegKinematics(robot.robot).forward(robot.joints.position, np.zeros(12))
    carried = -np.einsum("lij,li->lj", legs.jacobian, force @ robot.rotation).ravel()
    np.testing.assert_allclose(robot.output.effort, carried, atol=1e-9)


def moved(robot, seed):
    """The robot off its references, moving, two feet in the air."""
    rng = np.random.default_rng(seed)
    robot.balanced(NOW)
    robot.joints.position = robot.joints.position + rng.uniform(-0.1, 0.1, 12)
    robot.joints.velocity = rng.uniform(-1, 1, 12)
    robot.body.linear_velocity = rng.uniform(-0.5, 0.5, 3)
    robot.body.angular_velocity = rng.uniform(-0.5, 0.5, 3)
    robot.gait.walking = True
    robot.gait.contact = robot.gait.stance = [True, False, False, True]
    robot.gait.swing_position = (robot.feet + rng.uniform(-0.05, 0.05, (4, 3))).ravel()
    robot.gait.swing_velocity = rng.uniform(-1, 1, 12)
    robot.gait.swing_acceleration = rng.uniform(-10, 10, 12)
    return robot


@pytest.mark.parametrize("seed", range(5))
def test_commanded_torques_forces_and_accelerations_fit_the_equations_of_motion(bench, seed):
    """Forward dynamics with the commanded torque brings the contact points to rest and moves the trunk as relaxed."""
    robot = moved(bench(0.4), seed)
    assert law(robot).command(NOW)
    model = robot.model()
    standing = [0, 3]
    lever = np.outer(robot.gait.contact, (0.0, 0.0, -robot.robot.foot_radius_m))
    jacobian = model.point_jacobians(model.foot_position + lever)[standing].reshape(6, 18)
    drift = (model.foot_drift + np.cross(model.shank_drift, lever))[standing].ravel()
    given_up = np.concatenate((robot.output.relaxation, np.zeros(12)))
    # unknown accelerations (18) and contact forces (6): M a - J^T f = S tau - h, J (a - delta_b) = -drift - K_d J v
    system = np.block([[model.mass_matrix, -jacobian.T], [jacobian, np.zeros((6, 6))]])
    torque = np.concatenate((np.zeros(6), robot.output.effort))
    sliding = robot.config.whole_body.contact_damping * jacobian @ model.velocity
    right = np.concatenate((torque - model.bias, jacobian @ given_up - drift - sliding))
    answer = np.linalg.solve(system, right)
    motion, force = answer[:18] - given_up, answer[18:].reshape(2, 3)
    # the forces that this takes are inside their friction cones
    friction = robot.config.whole_body.relaxation.friction
    assert (np.hypot(force[:, 0], force[:, 1]) <= friction * force[:, 2] + 1e-2).all()
    # and but for what the relaxation gives up, the feet in the air accelerate as they should
    gains, feet = robot.config.whole_body, model.foot_position[[1, 2]]
    swing = model.point_jacobians(model.foot_position)[[1, 2]].reshape(6, 18)
    error = (robot.gait.swing_position.reshape(4, 3)[[1, 2]] - feet).ravel()
    speed = robot.gait.swing_velocity.reshape(4, 3)[[1, 2]].ravel() - swing @ model.velocity
    wanted = robot.gait.swing_acceleration.reshape(4, 3)[[1, 2]].ravel()
    wanted = wanted + gains.swing_stiffness * error + gains.swing_damping * speed
    got = swing @ motion + model.foot_drift[[1, 2]].ravel()
    np.testing.assert_allclose(got, wanted, atol=1e-2 * (1.0 + np.abs(wanted).max()))


@pytest.mark.parametrize("seed", range(5))
def test_gains_are_those_of_stance_and_swing(bench, seed):
    robot = moved(bench(), seed)
    law(robot).command(NOW)
    config = robot.config.whole_body
    standing = np.repeat(robot.gait.contact, 3)
    assert (robot.output.stiffness[standing] == config.stance_joint_stiffness_nm_prad).all()
    assert (robot.output.stiffness[~standing] == config.swing_joint_stiffness_nm_prad).all()
    assert (robot.output.damping[standing] == config.stance_joint_damping_nms_prad).all()
    assert (robot.output.damping[~standing] == config.swing_joint_damping_nms_prad).all()


def test_with_no_foot_on_the_ground_the_trunk_falls_free(bench):
    robot = moved(bench(), 1)
    robot.gait.contact = robot.gait.stance = False
    assert law(robot).command(NOW)
    assert np.isfinite(robot.output.effort).all()


def test_straight_legs_give_finite_commands(bench):
    robot = bench()
    robot.balanced(NOW)
    robot.joints.position = np.tile([0.0, 0.0, 0.0], 4)
    assert law(robot).command(NOW)
    for name in ("position", "velocity", "effort"):
        assert np.isfinite(getattr(robot.output, name)).all()
        assert np.abs(getattr(robot.output, name)).max() < 1e4


def test_planned_force_is_that_of_the_step_a_time_lies_in(bench):
    robot = bench()
    robot.balanced(NOW)
    steps = robot.config.mpc.steps
    robot.forces.force = np.repeat(np.arange(steps, dtype=float), 12)
    for step in range(steps):
        begin, end = robot.forces.knot_ns[step : step + 2].tolist()
        for at in (begin, (begin + end) // 2, end - 1):
            assert (planned_force(robot.forces.table[0], at) == step).all()
    assert (planned_force(robot.forces.table[0], 0) == 0).all()
    assert (planned_force(robot.forces.table[0], NOW + 10**12) == steps - 1).all()
