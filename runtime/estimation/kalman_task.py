# SPDX-License-Identifier: Apache-2.0
"""The default estimator: contact-aided Kalman filter with late localisation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.estimation import kalman
from runtime.estimation.body_output import StanceMemory, complete
from runtime.estimation.contact import loaded_feet, normal_force, rest_deviation
from runtime.estimation.inertial_input import InertialMemory, seconds_since_last, take_up
from runtime.estimation.kalman_config import KalmanConfig
from runtime.estimation.localization import LocalizationMemory, fuse_pose, remember
from runtime.models.inertial import InertialConfig
from runtime.models.leg_dynamics import LegDynamics
from runtime.models.leg_kinematics import LegState, leg_state
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import matrix_of_quaternion, quaternion_of_yaw, yaw_of_quaternion
from runtime.models.vectors import turned
from runtime.records import float64_array
from runtime.signals import BodyState, Gait, Imu, JointState, OperatorRequest, Pose
from runtime.tasks import Task

Array = npt.NDArray[np.float64]


class EstimatorMemory(LocalizationMemory, StanceMemory, InertialMemory):
    """The filter's state, and what it last took up."""

    force = float64_array("foot", "N")
    joint_velocity = float64_array("joint", "rad/s", "of the tick before")


class KalmanTask(Task):
    """Estimates the trunk's pose and twist from IMU, encoders and the localisation sensor.

    Args:
        description: of the robot.
        config: parameters.
        inertial: what an inertial sample may be.
        period_ns: of the loop.
        imu, joints, pose, gait, operator: records read; `gait` is that of the tick before.
        output: record written.
    """

    name = "estimator"

    def __init__(
        self,
        description: Quadruped,
        config: KalmanConfig,
        inertial: InertialConfig,
        period_ns: int,
        imu: Imu,
        joints: JointState,
        pose: Pose,
        gait: Gait,
        operator: OperatorRequest,
        output: BodyState,
    ) -> None:
        self._inertial, self._operator = table_of(inertial), operator
        self._parameters, self._robot, self._period_s = table_of(config), table_of(description), period_ns * 1e-9
        self._imu, self._joints, self._pose, self._gait, self._output = imu, joints, pose, gait, output
        self._dynamics = LegDynamics(description)
        self.reads, self.writes = (imu, joints, pose, gait, operator), (output,)
        self.state: EstimatorMemory = EstimatorMemory("/ugv/state/estimator", output.sizes)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        memory = self.state
        if not memory.started and not self._begin():
            return
        seconds, motion = _sample(
            now_ns,
            self._period_s,
            self._parameters,
            self._inertial,
            memory.table,
            self._imu.table,
            self._joints.table,
        )
        _estimate(
            now_ns,
            seconds,
            self._parameters,
            self._robot,
            memory.table,
            self._joints.table,
            self._pose.table,
            self._gait.table,
            self._operator.table,
            self._dynamics.free_torque(memory.acceleration, memory.rate, *motion),
            self._output.table,
        )

    def _begin(self) -> bool:
        """Start from the first pose of the localisation sensor, standing still."""
        pose = self._pose
        if pose.stamp_ns == 0 or not (np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()):
            return False
        kalman.start(self.state, pose.position, quaternion_of_yaw(yaw_of_quaternion(pose.orientation)))
        self.state.pose_sequence, self.state.pose_stamp_ns = pose.sequence, pose.stamp_ns
        self.state.acceleration = (0.0, 0.0, GRAVITY)
        return True


@compiled
def _sample(
    now_ns: int,
    period_s: float,
    configs: Sequence[KalmanConfig],
    inertials: Sequence[InertialConfig],
    memories: Sequence[EstimatorMemory],
    samples: Sequence[Imu],
    all_joints: Sequence[JointState],
) -> tuple[float, tuple[Array, Array, Array]]:
    """Take up the newest IMU sample if it is good, keeping the last good one otherwise; and look at the joints.

    Returns:
        Time since the last step, s; and positions, velocities and accelerations of the joints, (12,) each.
    """
    config, memory, joints = configs[0], memories[0], all_joints[0]
    seconds = seconds_since_last(memory, now_ns, period_s, config.longest_step_s)
    if not take_up(config, inertials[0], memory, samples[0], now_ns):
        _take_for_resting(memory)
    acceleration = (joints.velocity - memory.joint_velocity) / seconds
    memory.joint_velocity[:] = joints.velocity
    return seconds, (joints.position, joints.velocity, acceleration)


@compiled
def _take_for_resting(memory: EstimatorMemory) -> None:
    """Without samples a turn or an acceleration must not go on for ever."""
    upward = matrix_of_quaternion(memory.orientation)[2]
    memory.rate[:] = memory.rate_bias
    memory.acceleration[:] = memory.acceleration_bias + GRAVITY * upward


@compiled
def _estimate(
    now_ns: int,
    seconds: float,
    configs: Sequence[KalmanConfig],
    robots: Sequence[Quadruped],
    memories: Sequence[EstimatorMemory],
    all_joints: Sequence[JointState],
    poses: Sequence[Pose],
    gaits: Sequence[Gait],
    operators: Sequence[OperatorRequest],
    free_torque: Array,
    outputs: Sequence[BodyState],
) -> None:
    """Predict, correct by the standing feet and the newest pose, and publish."""
    config, robot, memory, joints, gait = configs[0], robots[0], memories[0], all_joints[0], gaits[0]
    legs = leg_state(robot, joints.position, joints.velocity)
    rotation = kalman.predict(memory, config, memory.acceleration, memory.rate, seconds)
    normal = memory.normal.copy() if memory.standing_known else np.array([0.0, 0.0, 1.0])
    measured = normal_force(legs, joints.effort - free_torque, turned(rotation.T, normal))
    memory.force += min(1.0, seconds / config.contact_filter_s) * (measured - memory.force)
    contact = np.ones(4, dtype=np.bool_)
    if gait.walking:
        contact = loaded_feet(config, memory.force, gait.stance, gait.foot_phase)
    _rest_on_feet(config, memory, legs, rotation, contact, gait, normal, robot.foot_radius_m)
    remember(memory, now_ns)
    if fuse_pose(config, memory, poses[0], operators[0].reset and not gait.balancing):
        memory.standing_known = False
    _publish(config, memory, legs, contact, robot.foot_radius_m, now_ns, seconds, outputs[0])


@compiled
def _rest_on_feet(
    config: KalmanConfig,
    memory: EstimatorMemory,
    legs: LegState,
    rotation: Array,
    contact: npt.NDArray[np.bool_],
    gait: Gait,
    normal: Array,
    foot_radius: float,
) -> None:
    """Correct by the contact points of the standing feet; one that seems to move is trusted less (Huber)."""
    standing, progress = np.arange(4), np.full(4, 0.5)
    if gait.walking:
        standing = np.flatnonzero(contact & gait.stance)
        progress = gait.foot_phase[standing]
    if standing.size:
        rate, deviation = memory.rate - memory.rate_bias, rest_deviation(config, progress)
        kalman.update(
            memory,
            kalman.contact_measurement(memory, rotation, rate, legs, standing, deviation, normal, foot_radius),
        )


@compiled
def _publish(
    config: KalmanConfig,
    memory: EstimatorMemory,
    legs: LegState,
    contact: npt.NDArray[np.bool_],
    foot_radius: float,
    now_ns: int,
    seconds: float,
    output: BodyState,
) -> None:
    output.stamp_ns = now_ns
    output.position[:] = memory.position
    output.orientation[:] = memory.orientation
    output.linear_velocity[:] = memory.velocity
    output.angular_velocity[:] = memory.rate - memory.rate_bias
    output.contact_force[:] = memory.force
    output.localization_age_ns = now_ns - memory.pose_stamp_ns
    output.localization_rejected = memory.poses_rejected
    output.localization_disputed = memory.poses_disputed
    output.imu_rejected = memory.samples_rejected
    output.imu_age_ns = now_ns - memory.imu_stamp_ns
    complete(
        output,
        memory,
        legs,
        matrix_of_quaternion(memory.orientation),
        contact,
        foot_radius,
        seconds / config.plane_time_s,
        seconds / config.course_time_s,
    )
