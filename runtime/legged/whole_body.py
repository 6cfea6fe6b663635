# SPDX-License-Identifier: Apache-2.0
"""Whole-body control: planned ground reactions and references in, one command per drive out (paper 000, eq 40-44)."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.legged.cascade import MotionTask, prioritised_motion
from runtime.legged.relaxation import RelaxationConfig, relax
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY, RigidBody
from runtime.models.rotations import (
    aligned_with_plane,
    matrix_of_quaternion,
    rotation_vector,
    rotation_z,
)
from runtime.optimization.qp import QpSolver
from runtime.signals import BodyState, ContactForces, Gait, JointCommand, JointState

Array = npt.NDArray[np.float64]
Gain = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
JointStiffness = Annotated[float, msgspec.Meta(ge=0.0, le=500.0)]
JointDamping = Annotated[float, msgspec.Meta(ge=0.0, le=5.0)]


class WholeBodyConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gains of the whole-body control.

    Attributes:
        relaxation: weights of the force QP.
        rotation_stiffness, rotation_damping: K_p, K_d of the body rotation task, 1/s^2 and 1/s.
        translation_stiffness, translation_damping: the same of the body translation task.
        swing_stiffness, swing_damping: the same of the swing foot task.
        stance_joint_stiffness_nm_prad, stance_joint_damping_nms_prad: k_p, k_d of eq 44 for standing legs.
        swing_joint_stiffness_nm_prad, swing_joint_damping_nms_prad: the same for legs in the air.
    """

    relaxation: RelaxationConfig = RelaxationConfig()
    rotation_stiffness: Gain = 100.0
    rotation_damping: Gain = 20.0
    translation_stiffness: Gain = 50.0
    translation_damping: Gain = 10.0
    swing_stiffness: Gain = 400.0
    swing_damping: Gain = 40.0
    stance_joint_stiffness_nm_prad: JointStiffness = 10.0
    stance_joint_damping_nms_prad: JointDamping = 0.5
    swing_joint_stiffness_nm_prad: JointStiffness = 30.0
    swing_joint_damping_nms_prad: JointDamping = 0.8


def planned_force(forces: ContactForces, now_ns: int) -> Array:
    """The plan's forces (4, 3) at a time."""
    knots = forces.knot_ns
    step = int(np.searchsorted(knots, now_ns, side="right")) - 1
    step = min(max(step, 0), knots.shape[0] - 2)
    return forces.force.reshape(-1, 4, 3)[step]


class WholeBodyLaw:
    """The control law with strict priorities (variants FpMW and pMW).

    Args:
        description: of the robot.
        config: gains.
        solver: of the force QP.
        body, joints, gait, forces: records read.
        output: record written.
    """

    def __init__(
        self,
        description: Quadruped,
        config: WholeBodyConfig,
        solver: QpSolver,
        body: BodyState,
        joints: JointState,
        gait: Gait,
        forces: ContactForces,
        output: JointCommand,
    ) -> None:
        self._config, self._solver = config, solver
        self._body, self._joints, self._gait, self._forces, self._output = body, joints, gait, forces, output
        self._model = RigidBody(description)
        self._foot_radius = description.foot_radius_m

    def command(self, now_ns: int) -> bool:
        """Write one command for every joint; false if the force QP failed and the planned forces were used."""
        body, joints, gait, model = self._body, self._joints, self._gait, self._model
        rotation = matrix_of_quaternion(body.orientation)
        spin = rotation @ body.angular_velocity
        model.update(
            body.position, body.orientation, rotation, body.linear_velocity, spin, joints.position, joints.velocity
        )
        plane = aligned_with_plane(float(self._forces.reference_orientation[2]), body.plane_normal)
        contact = gait.contact
        standing = np.flatnonzero(contact)
        flying = np.flatnonzero(~contact)
        lever = -self._foot_radius * plane[:, 2]
        planned = planned_force(self._forces, now_ns)
        if not gait.walking and not planned.any():
            planned = np.outer(contact, (0.0, 0.0, model.mass_kg * GRAVITY / max(1, standing.size)))
        contact_jacobian = self._contact_jacobian(standing, lever)
        tasks = self._body_tasks(now_ns, rotation, spin, planned, lever)
        if standing.size:
            tasks.insert(0, self._contact_task(contact_jacobian, standing, lever))
        if flying.size:
            tasks.append(self._swing_task(flying))
        motion = prioritised_motion(tasks)
        acceleration = motion[:, 2].copy()
        unbalanced = model.mass_matrix @ acceleration + model.bias
        if standing.size:
            answer = relax(
                self._config.relaxation,
                self._solver,
                model.mass_matrix[:6, :6],
                unbalanced[:6],
                contact_jacobian[:, :6],
                planned[standing],
                plane,
            )
            solved = answer.solved
            torque = (
                unbalanced[6:] + model.mass_matrix[6:, :6] @ answer.delta_b - answer.force.ravel() @ contact_jacobian[:, 6:]
            )
            self._output.relaxation = answer.delta_b
            self._output.qp_residual = answer.residual
        else:
            solved, torque = True, unbalanced[6:]
        self._write(now_ns, motion, torque, contact)
        return solved

    def _contact_jacobian(self, standing: npt.NDArray[np.intp], lever: Array) -> Array:
        """Jacobian of the contact points of the rolling feet, (3 n, 18): foot centre plus shank rate x lever."""
        model = self._model
        angular = model.shank_jacobian[standing]
        jacobian = model.foot_jacobian[standing] + np.cross(angular, lever, axisa=1, axisb=0, axisc=1)
        return jacobian.reshape(-1, 18)

    def _contact_task(self, jacobian: Array, standing: npt.NDArray[np.intp], lever: Array) -> MotionTask:
        """Priority 0: no motion at the contact points."""
        model = self._model
        drift = model.foot_drift[standing] + np.cross(model.shank_drift[standing], lever)
        demand = np.zeros((3 * standing.size, 3))
        demand[:, 2] = -drift.ravel()
        return MotionTask(jacobian, demand)

    def _body_tasks(self, now_ns: int, rotation: Array, spin: Array, planned: Array, lever: Array) -> list[MotionTask]:
        """Priorities 1 and 2: body rotation, then body translation."""
        config, model, forces, body = self._config, self._model, self._forces, self._body
        ahead = (now_ns - forces.stamp_ns) * 1e-9
        yaw = forces.reference_orientation[2] + forces.reference_yaw_rate * ahead
        target = aligned_with_plane(yaw, body.plane_normal)
        rotation_error = rotation_vector(target @ rotation.T)
        rate = np.array([0.0, 0.0, forces.reference_yaw_rate])
        contact_force = planned * self._gait.contact[:, None]
        arm = model.foot_position + lever - model.center_of_mass
        moment = np.cross(arm, contact_force).sum(axis=0)
        angular = np.linalg.solve(model.inertia_about_com(), moment)
        angular += config.rotation_stiffness * rotation_error + config.rotation_damping * (rate - spin)

        reference = forces.reference_position + forces.reference_velocity * ahead
        position_error = reference - model.center_of_mass
        velocity_error = forces.reference_velocity - model.com_velocity
        linear = contact_force.sum(axis=0) / model.mass_kg - (0.0, 0.0, GRAVITY)
        linear = linear + config.translation_stiffness * position_error + config.translation_damping * velocity_error

        turning, moving = np.zeros((3, 18)), np.zeros((3, 18))
        turning[:, 3:6] = np.eye(3)
        moving[:, :3] = np.eye(3)
        return [
            MotionTask(turning, np.stack((rotation_error, rate, angular), axis=1)),
            MotionTask(moving, np.stack((position_error, forces.reference_velocity, linear), axis=1)),
        ]

    def _swing_task(self, flying: npt.NDArray[np.intp]) -> MotionTask:
        """Priority 3: feet in the air follow their references."""
        config, model, gait = self._config, self._model, self._gait
        position = gait.swing_position.reshape(4, 3)[flying]
        velocity = gait.swing_velocity.reshape(4, 3)[flying]
        error = position - model.foot_position[flying]
        acceleration = (
            gait.swing_acceleration.reshape(4, 3)[flying]
            + config.swing_stiffness * error
            + config.swing_damping * (velocity - model.foot_velocity[flying])
            - model.foot_drift[flying]
        )
        demand = np.stack((error.ravel(), velocity.ravel(), acceleration.ravel()), axis=1)
        return MotionTask(model.foot_jacobian[flying].reshape(-1, 18), demand)

    def _write(self, now_ns: int, motion: Array, torque: Array, contact: npt.NDArray[np.bool_]) -> None:
        """Eq 41 and 44: targets and gains for the drives' own loops."""
        config, output = self._config, self._output
        standing = np.repeat(contact, 3)
        output.stamp_ns = now_ns
        output.position = self._joints.position + motion[6:, 0]
        output.velocity = motion[6:, 1]
        output.effort = torque
        output.stiffness = np.where(
            standing, config.stance_joint_stiffness_nm_prad, config.swing_joint_stiffness_nm_prad
        )
        output.damping = np.where(standing, config.stance_joint_damping_nms_prad, config.swing_joint_damping_nms_prad)
