# SPDX-License-Identifier: Apache-2.0
"""The control law without whole-body control (variant FpM): J^T f for standing legs, Cartesian PD for the others."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.legged.motion_tasks import JointDamping
from runtime.legged.whole_body import planned_force
from runtime.models.leg_kinematics import LegKinematics, LegState
from runtime.models.quadruped import Quadruped
from runtime.models.rotations import matrix_of_quaternion
from runtime.models.vectors import skew
from runtime.signals import BodyState, ContactForces, Gait, JointCommand, JointState

Array = npt.NDArray[np.float64]
RATE_DAMPING_M2 = 1e-4
"""Damping of the leg Jacobians' inverses, whose squares are about 0.05."""
Gain = Annotated[float, msgspec.Meta(ge=0.0, le=1e5)]


class JacobianTransposeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gains of the law without whole-body control.

    Attributes:
        swing_stiffness_n_pm, swing_damping_ns_pm: of the feet in the air.
        stance_joint_damping_nms_prad, swing_joint_damping_nms_prad: of the joints of standing legs and of others, by
            the drives.
    """

    swing_stiffness_n_pm: Gain = 1000.0
    swing_damping_ns_pm: Gain = 10.0
    stance_joint_damping_nms_prad: JointDamping = 0.2
    swing_joint_damping_nms_prad: JointDamping = 1.0


class JacobianTransposeLaw:
    """Maps planned forces to torques leg by leg.

    Args:
        description: of the robot.
        config: gains.
        body, joints, gait, forces: records read.
        output: record written.
    """

    def __init__(
        self,
        description: Quadruped,
        config: JacobianTransposeConfig,
        body: BodyState,
        joints: JointState,
        gait: Gait,
        forces: ContactForces,
        output: JointCommand,
    ) -> None:
        self._config = config
        self._body, self._joints, self._gait, self._forces, self._output = body, joints, gait, forces, output
        self._legs = LegKinematics(description)

    def command(self, now_ns: int) -> bool:
        """Write one command for every joint; nothing here can fail."""
        config, gait, body, output = self._config, self._gait, self._body, self._output
        legs = self._legs.forward(self._joints.position, self._joints.velocity)
        rotation = matrix_of_quaternion(body.orientation)
        contact = gait.contact[:, None]
        pull = config.swing_stiffness_n_pm * (gait.swing_position - body.foot_position)
        pull += config.swing_damping_ns_pm * (gait.swing_velocity - body.foot_velocity)
        force = np.where(contact, -planned_force(self._forces.table[0], now_ns), pull.reshape(4, 3))
        output.stamp_ns = now_ns
        output.position = self._joints.position
        output.velocity = self._joint_rates(legs, rotation)
        output.effort = np.matmul(legs.jacobian.transpose(0, 2, 1), (force @ rotation)[:, :, None]).ravel()
        output.stiffness = 0.0
        damping = (config.swing_joint_damping_nms_prad, config.stance_joint_damping_nms_prad)
        output.damping = np.repeat(np.where(gait.contact, damping[1], damping[0]), 3)
        return True

    def _joint_rates(self, legs: LegState, rotation: Array) -> Array:
        """Joint velocities (12,) that move the feet as referred, at rest where they stand, under the moving trunk."""
        body = self._body
        wanted = (self._gait.swing_velocity.reshape(4, 3) - body.linear_velocity) @ rotation
        wanted += legs.position @ skew(body.angular_velocity)
        transposed = legs.jacobian.transpose(0, 2, 1)
        normal = transposed @ legs.jacobian + RATE_DAMPING_M2 * np.eye(3)
        return np.asarray(np.linalg.solve(normal, transposed @ wanted[:, :, None]).ravel())
