# SPDX-License-Identifier: Apache-2.0
"""The estimator that knows: the simulator's own state (`--estimator truth`)."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.compiled import compiled, table_of
from runtime.estimation.body_output import StanceMemory, complete
from runtime.estimation.inertial_input import seconds_since_last
from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_kinematics import leg_state
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
        self._parameters, self._robot, self._period_s = table_of(config), table_of(description), period_ns * 1e-9
        self._truth, self._joints, self._output = truth, joints, output
        self.reads, self.writes = (truth, joints), (output,)
        self.state: StanceMemory = StanceMemory("/ugv/state/estimator", output.sizes)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        if self._truth.stamp_ns == 0 and now_ns > 0:
            return
        _estimate(
            now_ns,
            self._period_s,
            self._parameters,
            self._robot,
            self.state.table,
            self._truth.table,
            self._joints.table,
            self._output.table,
        )


@compiled
def _estimate(
    now_ns: int,
    period_s: float,
    configs: Sequence[KalmanConfig],
    robots: Sequence[Quadruped],
    memories: Sequence[StanceMemory],
    truths: Sequence[Truth],
    all_joints: Sequence[JointState],
    outputs: Sequence[BodyState],
) -> None:
    config, robot, truth, joints, output = configs[0], robots[0], truths[0], all_joints[0], outputs[0]
    seconds = seconds_since_last(memories[0], now_ns, period_s, config.longest_step_s)
    output.stamp_ns = now_ns
    output.position[:] = truth.position
    output.orientation[:] = truth.orientation
    output.linear_velocity[:] = truth.linear_velocity
    output.angular_velocity[:] = truth.angular_velocity
    output.contact_force[:] = truth.contact_force[2::3]
    complete(
        output,
        memories[0],
        leg_state(robot, joints.position, joints.velocity),
        matrix_of_quaternion(truth.orientation),
        output.contact_force > config.contact_force_n,
        robot.foot_radius_m,
        seconds / config.plane_time_s,
        seconds / config.course_time_s,
    )
