# SPDX-License-Identifier: Apache-2.0
"""The default estimator: contact-aided Kalman filter with late localisation."""

from __future__ import annotations

from math import isfinite

import numpy as np
import numpy.typing as npt

from runtime.estimation import kalman
from runtime.estimation.body_output import StanceMemory, complete
from runtime.estimation.contact import loaded_feet, normal_force, rest_deviation
from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_dynamics import LegDynamics
from runtime.models.leg_kinematics import LegKinematics, LegState
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import matrix_of_quaternion, quaternion_of_yaw, wrapped, yaw_of_quaternion
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
        self._config, self._period_s = config, period_ns * 1e-9
        self._imu, self._joints, self._pose, self._gait, self._output = imu, joints, pose, gait, output
        self._legs, self._dynamics = LegKinematics(description), LegDynamics(description)
        self._foot_radius = description.foot_radius_m
        self.reads, self.writes = (imu, joints, pose, gait), (output,)
        self.state: EstimatorMemory = EstimatorMemory("/ugv/state/estimator", output.sizes)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        memory, config = self.state, self._config
        if not memory.started and not self._begin():
            return
        legs = self._legs.forward(self._joints.position, self._joints.velocity)
        self._take_sample()
        rotation = kalman.predict(memory, config, memory.acceleration, memory.rate, self._period_s)
        contact = self._contacts(legs, rotation)
        self._rest_on_feet(legs, rotation, contact)
        self._remember(now_ns)
        self._fuse_pose(now_ns)
        self._publish(now_ns, legs, contact)

    def _rest_on_feet(self, legs: LegState, rotation: Array, contact: npt.NDArray[np.bool_]) -> None:
        """Correct by the contact points of the standing feet; one that seems to move is trusted less (Huber)."""
        memory, config, gait = self.state, self._config, self._gait
        progress = gait.foot_phase.tolist() if gait.walking else [0.5] * 4
        standing = np.flatnonzero(contact & gait.stance) if gait.walking else np.arange(4)
        if not standing.size:
            return
        deviation = np.array([rest_deviation(config, progress[foot]) for foot in standing])
        measured = kalman.contact_measurement(
            memory,
            rotation,
            memory.rate - memory.rate_bias,
            legs,
            standing,
            deviation,
            self._normal(),
            self._foot_radius,
        )
        kalman.update(memory, measured)

    def _begin(self) -> bool:
        """Start from the first pose of the localisation sensor, standing still."""
        pose = self._pose
        if pose.stamp_ns == 0 or not (np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()):
            return False
        kalman.start(self.state, pose.position, quaternion_of_yaw(yaw_of_quaternion(pose.orientation)))
        self.state.pose_sequence, self.state.pose_stamp_ns = pose.sequence, pose.stamp_ns
        self.state.acceleration = (0.0, 0.0, GRAVITY)
        return True

    def _take_sample(self) -> None:
        """Use the newest IMU sample if it is finite; keep the last good one otherwise."""
        imu, memory = self._imu, self.state
        if imu.sequence == memory.imu_sequence:
            return
        memory.imu_sequence = imu.sequence
        if all(map(isfinite, imu.angular_velocity.tolist() + imu.linear_acceleration.tolist())):
            memory.rate, memory.acceleration = imu.angular_velocity, imu.linear_acceleration
        else:
            memory.samples_rejected += 1

    def _normal(self) -> Array:
        """The ground's normal as known before this tick."""
        memory = self.state
        return memory.normal if memory.standing_known else np.array([0.0, 0.0, 1.0])

    def _contacts(self, legs: LegState, rotation: Array) -> npt.NDArray[np.bool_]:
        memory, config, gait = self.state, self._config, self._gait
        joints = self._joints
        acceleration = (joints.velocity - memory.joint_velocity) / self._period_s
        memory.joint_velocity = joints.velocity
        free = self._dynamics.free_torque(
            memory.acceleration, memory.rate, joints.position, joints.velocity, acceleration
        )
        measured = normal_force(legs, joints.effort - free, self._normal() @ rotation)
        memory.force += min(1.0, self._period_s / config.contact_filter_s) * (measured - memory.force)
        if not gait.walking:
            return np.ones(4, dtype=bool)
        return loaded_feet(config, memory.force, gait.stance, gait.foot_phase)

    def _remember(self, now_ns: int) -> None:
        """Put the present pose into the ring of past ones."""
        memory = self.state
        slot = memory.history_count % HISTORY
        memory.history_count += 1
        memory.history_ns[slot] = now_ns
        memory.history[4 * slot : 4 * slot + 3] = memory.position
        memory.history[4 * slot + 3] = yaw_of_quaternion(memory.orientation)

    def _fuse_pose(self, now_ns: int) -> None:
        """Correct by the localisation pose, compared with the estimate at the time it was acquired."""
        memory, pose, config = self.state, self._pose, self._config
        if pose.sequence == memory.pose_sequence:
            return
        memory.pose_sequence = pose.sequence
        past = memory.history.reshape(HISTORY, 4)
        ages = np.abs(memory.history_ns - pose.stamp_ns)
        slot = int(np.argmin(ages))
        finite = np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()
        if not finite or ages[slot] > 2 * self._period_s * 1e9:
            memory.poses_rejected += 1
            return
        error = pose.position - past[slot, :3]
        yaw_error = wrapped(yaw_of_quaternion(pose.orientation) - past[slot, 3])
        measured = kalman.pose_measurement(config, error, yaw_error)
        spread = memory.covariance.reshape(kalman.SIZE, kalman.SIZE).diagonal()[[0, 1, 2, 8]] + measured.variance
        if (np.square(measured.residual) > config.localization_gate**2 * spread).any():
            memory.poses_rejected += 1
            return
        change = kalman.update(memory, measured)
        past[:, :3] += change[kalman.POSITION]
        past[:, 3] += change[kalman.ROTATION][2]
        memory.pose_stamp_ns = pose.stamp_ns

    def _publish(self, now_ns: int, legs: LegState, contact: npt.NDArray[np.bool_]) -> None:
        memory, output, config = self.state, self._output, self._config
        output.stamp_ns = now_ns
        rotation = matrix_of_quaternion(memory.orientation)
        output.position, output.orientation = memory.position, memory.orientation
        output.linear_velocity = memory.velocity
        output.angular_velocity = memory.rate - memory.rate_bias
        output.contact_force = memory.force
        output.localization_age_ns = now_ns - memory.pose_stamp_ns
        output.localization_rejected = memory.poses_rejected
        output.imu_rejected = memory.samples_rejected
        complete(
            output,
            memory,
            legs,
            rotation,
            contact,
            self._foot_radius,
            self._period_s / config.plane_time_s,
            self._period_s / config.course_time_s,
        )
