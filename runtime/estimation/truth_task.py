# SPDX-License-Identifier: Apache-2.0
"""The estimator that knows: the simulator's own state (`--estimator truth`)."""

from __future__ import annotations

from runtime.estimation.body_output import StanceMemory, complete
from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_kinematics import LegKinematics
from runtime.models.quadruped import Quadruped
from runtime.models.rotations import matrix_of_quaternion
from runtime.signals import BodyState, JointState, Truth
from runtime.tasks import Task


class TruthTask(Task):
    """Passes the true pose, twist and contacts on.

    Args:
        description: of the robot.
        config: filter constants shared with the Kalman filter.
        period_ns: of the loop.
        truth, joints: records read.
        output: record written.
    """

    name = "estimator"

    def __init__(
        self,
        description: Quadruped,
        config: KalmanConfig,
        period_ns: int,
        truth: Truth,
        joints: JointState,
        output: BodyState,
    ) -> None:
        self._config, self._period_s = config, period_ns * 1e-9
        self._truth, self._joints, self._output = truth, joints, output
        self._legs = LegKinematics(description)
        self._foot_radius = description.foot_radius_m
        self.reads, self.writes = (truth, joints), (output,)
        self.state: StanceMemory = StanceMemory("/ugv/state/estimator", output.sizes)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        truth, output = self._truth, self._output
        if truth.stamp_ns == 0 and now_ns > 0:
            return
        output.stamp_ns = now_ns
        output.position = truth.position
        output.orientation = truth.orientation
        output.linear_velocity = truth.linear_velocity
        output.angular_velocity = truth.angular_velocity
        normal_force = truth.contact_force.reshape(4, 3)[:, 2]
        output.contact_force = normal_force
        legs = self._legs.forward(self._joints.position, self._joints.velocity)
        complete(
            output,
            self.state,
            legs,
            matrix_of_quaternion(truth.orientation),
            normal_force > self._config.contact_force_n,
            self._foot_radius,
            self._period_s / self._config.plane_time_s,
            self._period_s / self._config.course_time_s,
        )
