# SPDX-License-Identifier: Apache-2.0
"""Whole-body control: planned ground reactions and references in, one command per drive out (paper 000, eq 40-44)."""

from __future__ import annotations

from bisect import bisect_right
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
)
from runtime.models.vectors import skew, solve_three, total_moment
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


_TURNING, _MOVING = np.zeros((3, 18)), np.zeros((3, 18))
_TURNING[:, 3:6] = _MOVING[:, :3] = np.eye(3)


def planned_force(forces: ContactForces, now_ns: int) -> Array:
    """The plan's forces (4, 3) at a time."""
    knots = forces.knot_ns.tolist()
    step = min(max(bisect_right(knots, now_ns) - 1, 0), len(knots) - 2)
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
        ahead_s = (now_ns - self._forces.stamp_ns) * 1e-9
        yaw = self._forces.reference_orientation[2] + self._forces.reference_yaw_rate * ahead_s
        plane = aligned_with_plane(yaw, body.plane_normal)
        contact = gait.contact
        # a round foot rolls: what rests is the point below its centre
        levers = contact[:, None] * (-self._foot_radius * plane[:, 2])
        points = model.foot_position + levers
        jacobians = model.point_jacobians(points)
        planned = planned_force(self._forces, now_ns) * contact[:, None]
        standing, flying = np.flatnonzero(contact), np.flatnonzero(~contact)

        tasks = self._body_tasks(ahead_s, rotation, spin, plane, planned, points)
        if standing.size:
            tasks.insert(0, self._contact_task(jacobians[standing], standing, levers))
        if flying.size:
            tasks.append(self._swing_task(jacobians[flying], flying))
        motion = prioritised_motion(tasks)
        torque, solved = self._torque(motion[:, 2], jacobians[standing].reshape(-1, 18), planned[standing], plane)
        self._write(now_ns, motion, torque, contact)
        return solved

    def _torque(self, acceleration: Array, jacobian: Array, planned: Array, plane: Array) -> tuple[Array, bool]:
        """Joint torques (12,) by inverse dynamics (eq 43), after the force QP; and whether that succeeded."""
        model, output = self._model, self._output
        wrench = model.mass_matrix @ acceleration + model.bias
        if not planned.size:
            return wrench[6:], True
        answer = relax(
            self._config.relaxation,
            self._solver,
            model.mass_matrix[:6, :6],
            wrench[:6],
            jacobian[:, :6],
            planned,
            plane,
        )
        output.relaxation, output.qp_residual = answer.delta_b, answer.residual
        torque = wrench[6:] + model.mass_matrix[6:, :6] @ answer.delta_b - answer.force.ravel() @ jacobian[:, 6:]
        return torque, answer.solved

    def _contact_task(self, jacobians: Array, standing: npt.NDArray[np.intp], levers: Array) -> MotionTask:
        """Priority 0: no motion at the contact points."""
        model = self._model
        drift = model.foot_drift[standing] + model.shank_drift[standing] @ skew(levers[standing[0]])
        demand = np.zeros((3 * standing.size, 3))
        demand[:, 2] = -drift.ravel()
        return MotionTask(jacobians.reshape(-1, 18), demand)

    def _body_tasks(
        self, ahead_s: float, rotation: Array, spin: Array, plane: Array, planned: Array, points: Array
    ) -> list[MotionTask]:
        """Priorities 1 and 2: body rotation, then body translation.

        The feed-forward is the acceleration that the planned forces give the trunk as a single rigid body.
        """
        config, model, forces = self._config, self._model, self._forces
        turning, moving = np.zeros((3, 3)), np.zeros((3, 3))
        turning[:, 0] = rotation_vector(plane @ rotation.T)
        turning[2, 1] = forces.reference_yaw_rate
        turning[:, 2] = solve_three(model.inertia, total_moment(points - model.center_of_mass, planned))
        turning[:, 2] += config.rotation_stiffness * turning[:, 0] + config.rotation_damping * (turning[:, 1] - spin)

        velocity = forces.reference_velocity
        moving[:, 0] = forces.reference_position + velocity * ahead_s - model.center_of_mass
        moving[:, 1] = velocity
        moving[:, 2] = planned.sum(axis=0) / model.mass_kg
        moving[2, 2] -= GRAVITY
        moving[:, 2] += config.translation_stiffness * moving[:, 0]
        moving[:, 2] += config.translation_damping * (velocity - model.com_velocity)
        return [MotionTask(_TURNING, turning), MotionTask(_MOVING, moving)]

    def _swing_task(self, jacobians: Array, flying: npt.NDArray[np.intp]) -> MotionTask:
        """Priority 3: feet in the air follow their references."""
        config, model, gait = self._config, self._model, self._gait
        jacobian = jacobians.reshape(-1, 18)
        demand = np.empty((3 * flying.size, 3))
        demand[:, 0] = (gait.swing_position.reshape(4, 3)[flying] - model.foot_position[flying]).ravel()
        demand[:, 1] = gait.swing_velocity.reshape(4, 3)[flying].ravel()
        demand[:, 2] = (gait.swing_acceleration.reshape(4, 3)[flying] - model.foot_drift[flying]).ravel()
        demand[:, 2] += config.swing_stiffness * demand[:, 0]
        demand[:, 2] += config.swing_damping * (demand[:, 1] - jacobian @ model.velocity)
        return MotionTask(jacobian, demand)

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
