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
from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_dynamics import LegDynamics
from runtime.models.leg_kinematics import LegState, leg_state
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import matrix_of_quaternion, quaternion_of_yaw, wrapped, yaw_of_quaternion
from runtime.models.vectors import turned
from runtime.records import float64_array, int64, int64_array, uint32
from runtime.signals import BodyState, Gait, Imu, JointState, Pose
from runtime.tasks import Task

Array = npt.NDArray[np.float64]
HISTORY = 128
"""Ticks of past poses kept for late measurements (256 ms at 500 Hz)."""


class EstimatorMemory(kalman.KalmanMemory, StanceMemory):
    """The filter's state and the past that late poses are compared with."""

    rate = float64_array(3, "rad/s", "last finite sample")
    acceleration = float64_array(3, "m/s^2", "last finite sample")
    imu_sequence = int64()
    pose_sequence = int64()
    pose_stamp_ns = int64("ns")
    poses_rejected = uint32()
    samples_rejected = uint32()
    force = float64_array("foot", "N")
    joint_velocity = float64_array("joint", "rad/s", "of the tick before")
    history_count = int64()
    history_ns = int64_array(HISTORY, "ns")
    history = float64_array(4 * HISTORY, "", "x y z yaw of each")


class KalmanTask(Task):
    """Estimates the trunk's pose and twist from IMU, encoders and the localisation sensor.

    Args:
        description: of the robot.
        config: parameters.
        period_ns: of the loop.
        imu, joints, pose, gait: records read; `gait` is that of the tick before.
        output: record written.
    """

    name = "estimator"

    def __init__(
        self,
        description: Quadruped,
        config: KalmanConfig,
        period_ns: int,
        imu: Imu,
        joints: JointState,
        pose: Pose,
        gait: Gait,
        output: BodyState,
    ) -> None:
        self._parameters, self._robot, self._period_s = table_of(config), table_of(description), period_ns * 1e-9
        self._imu, self._joints, self._pose, self._gait, self._output = imu, joints, pose, gait, output
        self._dynamics = LegDynamics(description)
        self.reads, self.writes = (imu, joints, pose, gait), (output,)
        self.state: EstimatorMemory = EstimatorMemory("/ugv/state/estimator", output.sizes)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        memory = self.state
        if not memory.started and not self._begin():
            return
        motion = _sample(self._period_s, memory.table, self._imu.table, self._joints.table)
        _estimate(
            now_ns,
            self._period_s,
            self._parameters,
            self._robot,
            memory.table,
            self._joints.table,
            self._pose.table,
            self._gait.table,
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
    period_s: float, memories: Sequence[EstimatorMemory], samples: Sequence[Imu], all_joints: Sequence[JointState]
) -> tuple[Array, Array, Array]:
    """Take up the newest IMU sample if it is finite, keeping the last good one otherwise; and look at the joints.

    Returns:
        Positions, velocities and accelerations of the joints, (12,) each.
    """
    memory, imu, joints = memories[0], samples[0], all_joints[0]
    if imu.sequence != memory.imu_sequence:
        memory.imu_sequence = imu.sequence
        if np.isfinite(imu.angular_velocity).all() and np.isfinite(imu.linear_acceleration).all():
            memory.rate[:] = imu.angular_velocity
            memory.acceleration[:] = imu.linear_acceleration
        else:
            memory.samples_rejected += 1
    acceleration = (joints.velocity - memory.joint_velocity) / period_s
    memory.joint_velocity[:] = joints.velocity
    return joints.position, joints.velocity, acceleration


@compiled
def _estimate(
    now_ns: int,
    period_s: float,
    configs: Sequence[KalmanConfig],
    robots: Sequence[Quadruped],
    memories: Sequence[EstimatorMemory],
    all_joints: Sequence[JointState],
    poses: Sequence[Pose],
    gaits: Sequence[Gait],
    free_torque: Array,
    outputs: Sequence[BodyState],
) -> None:
    """Predict, correct by the standing feet and the newest pose, and publish."""
    config, robot, memory, joints, gait = configs[0], robots[0], memories[0], all_joints[0], gaits[0]
    legs = leg_state(robot, joints.position, joints.velocity)
    rotation = kalman.predict(memory, config, memory.acceleration, memory.rate, period_s)
    normal = memory.normal.copy() if memory.standing_known else np.array([0.0, 0.0, 1.0])
    measured = normal_force(legs, joints.effort - free_torque, turned(rotation.T, normal))
    memory.force += min(1.0, period_s / config.contact_filter_s) * (measured - memory.force)
    contact = np.ones(4, dtype=np.bool_)
    if gait.walking:
        contact = loaded_feet(config, memory.force, gait.stance, gait.foot_phase)
    _rest_on_feet(config, memory, legs, rotation, contact, gait, normal, robot.foot_radius_m)
    _remember(memory, now_ns)
    _fuse_pose(config, memory, poses[0], 2 * period_s * 1e9)
    _publish(config, memory, legs, contact, robot.foot_radius_m, now_ns, period_s, outputs[0])


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
def _remember(memory: EstimatorMemory, now_ns: int) -> None:
    """Put the present pose into the ring of past ones."""
    slot = memory.history_count % HISTORY
    memory.history_count += 1
    memory.history_ns[slot] = now_ns
    memory.history[4 * slot : 4 * slot + 3] = memory.position
    memory.history[4 * slot + 3] = yaw_of_quaternion(memory.orientation)


@compiled
def _fuse_pose(config: KalmanConfig, memory: EstimatorMemory, pose: Pose, oldest_ns: float) -> None:
    """Correct by the localisation pose, compared with the estimate at the time it was acquired."""
    if pose.sequence == memory.pose_sequence:
        return
    memory.pose_sequence = pose.sequence
    past = memory.history.reshape(HISTORY, 4)
    ages = np.abs(memory.history_ns - pose.stamp_ns)
    slot = np.argmin(ages)
    if not (np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()) or ages[slot] > oldest_ns:
        memory.poses_rejected += 1
        return
    yaw_error = wrapped(yaw_of_quaternion(pose.orientation) - past[slot, 3])
    measured = kalman.pose_measurement(config, pose.position - past[slot, :3], yaw_error)
    covariance = memory.covariance.reshape(kalman.SIZE, kalman.SIZE)
    for row, state in enumerate((0, 1, 2, 8)):
        spread = covariance[state, state] + measured.variance[row]
        if not measured.residual[row] ** 2 <= config.localization_gate**2 * spread:
            memory.poses_rejected += 1
            return
    change = kalman.update(memory, measured)
    for row in range(HISTORY):
        past[row, :3] += change[0:3]
        past[row, 3] += change[8]
    memory.pose_stamp_ns = pose.stamp_ns


@compiled
def _publish(
    config: KalmanConfig,
    memory: EstimatorMemory,
    legs: LegState,
    contact: npt.NDArray[np.bool_],
    foot_radius: float,
    now_ns: int,
    period_s: float,
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
    output.imu_rejected = memory.samples_rejected
    complete(
        output,
        memory,
        legs,
        matrix_of_quaternion(memory.orientation),
        contact,
        foot_radius,
        period_s / config.plane_time_s,
        period_s / config.course_time_s,
    )
