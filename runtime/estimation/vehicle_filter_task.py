# SPDX-License-Identifier: Apache-2.0
"""The vehicle's default estimator: wheel odometry, IMU and late localisation in one Kalman filter."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.estimation import kalman
from runtime.estimation.inertial_input import seconds_since_last, take_up
from runtime.estimation.localization import fuse_pose, remember
from runtime.estimation.vehicle_filter import (
    VehicleFilterMemory,
    WheelReadings,
    leveled,
    motion_sample,
    planar_covariance,
    rest_measurement,
    rests,
    wheel_measurement,
)
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.estimation.wheel_odometry import SLIPPING, rolling_equations, slip_ratios
from runtime.models.inertial import InertialConfig, is_finite_sample
from runtime.models.rotations import matrix_of_quaternion, yaw_of_quaternion
from runtime.models.vectors import turned
from runtime.signals import Imu, OperatorRequest, Pose
from runtime.tasks import Task
from runtime.vehicle_signals import VehicleState, WheelState

Array = npt.NDArray[np.float64]
LEAST_WHEELS = 2
"""Readings that make a twist."""


class VehicleFilterTask(Task):
    """Estimates the vehicle's pose and twist from its wheels, the IMU and the localisation sensor.

    Args:
        positions: of the wheels in base, (4, 2), m.
        radius: of the wheels, m.
        wheel_frames: which of the control unit's state frames carries each wheel's angle and speed, (4,).
        config: parameters.
        inertial: what an inertial sample may be.
        period_ns: of the loop.
        imu, wheels, pose, operator: records read.
        output: record written.
    """

    name = "estimator"

    def __init__(
        self,
        positions: Array,
        radius: float,
        wheel_frames: Sequence[int],
        config: VehicleFilterConfig,
        inertial: InertialConfig,
        period_ns: int,
        imu: Imu,
        wheels: WheelState,
        pose: Pose,
        operator: OperatorRequest,
        output: VehicleState,
    ) -> None:
        self._positions, self._radius = np.array(positions, dtype=np.float64), float(radius)
        self._wheel_frames = np.array(wheel_frames, dtype=np.int64)
        self._parameters, self._inertial, self._period_s = table_of(config), table_of(inertial), period_ns * 1e-9
        self._imu, self._wheels, self._pose, self._operator, self._output = imu, wheels, pose, operator, output
        self.reads, self.writes = (imu, wheels, pose, operator), (output,)
        self.state: VehicleFilterMemory = VehicleFilterMemory("/ugv/state/estimator", output.sizes)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        if not self.state.started and not self._begin(now_ns):
            return
        _estimate(
            now_ns,
            self._period_s,
            self._positions,
            self._radius,
            self._wheel_frames,
            self._parameters,
            self._inertial,
            self.state.table,
            self._imu.table,
            self._wheels.table,
            self._pose.table,
            self._operator.table,
            self._output.table,
        )

    def _begin(self, now_ns: int) -> bool:
        """Start from the first pose of the localisation sensor and the specific force, standing still."""
        pose, imu, memory = self._pose, self._imu, self.state
        known = np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()
        if pose.stamp_ns == 0 or imu.stamp_ns == 0 or not (known and is_finite_sample(imu.table[0])):
            return False
        kalman.start(memory, pose.position, leveled(yaw_of_quaternion(pose.orientation), imu.linear_acceleration))
        memory.pose_sequence, memory.pose_stamp_ns = pose.sequence, pose.stamp_ns
        memory.acceleration = memory.acceleration_before = imu.linear_acceleration
        memory.moved_ns = now_ns
        return True


@compiled
def _estimate(
    now_ns: int,
    period_s: float,
    positions: Array,
    radius: float,
    wheel_frames: npt.NDArray[np.int64],
    configs: Sequence[VehicleFilterConfig],
    inertials: Sequence[InertialConfig],
    memories: Sequence[VehicleFilterMemory],
    samples: Sequence[Imu],
    all_wheels: Sequence[WheelState],
    poses: Sequence[Pose],
    operators: Sequence[OperatorRequest],
    outputs: Sequence[VehicleState],
) -> None:
    """Predict, correct by the wheels or by rest, then by the newest pose, and publish."""
    config, memory = configs[0], memories[0]
    seconds = seconds_since_last(memory, now_ns, period_s, config.longest_step_s)
    fresh = take_up(config, inertials[0], memory, samples[0], now_ns)
    acceleration, rate = motion_sample(memory, matrix_of_quaternion(memory.orientation), fresh)
    rotation = kalman.predict(memory, config, acceleration, rate, seconds)
    wheels = _readings(config, memory, positions, radius, wheel_frames, all_wheels[0], now_ns)
    if rests(config, memory, wheels, now_ns, seconds):
        kalman.update(memory, rest_measurement(config, memory, seconds, fresh))
    elif wheels.usable.sum() >= LEAST_WHEELS:
        kalman.update(memory, wheel_measurement(config, memory, rotation, wheels, seconds, fresh))
    remember(memory, now_ns)
    fuse_pose(config, memory, poses[0], operators[0].reset and memory.resting)
    _publish(memory, wheels, now_ns, outputs[0])


@compiled
def _readings(
    config: VehicleFilterConfig,
    memory: VehicleFilterMemory,
    positions: Array,
    radius: float,
    wheel_frames: npt.NDArray[np.int64],
    wheels: WheelState,
    now_ns: int,
) -> WheelReadings:
    """The wheels' equations; one whose reading is old or no number, or one of whose motors is at fault, has none."""
    used_ns, oldest_ns = 0, 0
    steering, speed = wheels.steering.copy(), wheels.speed.copy()
    count = positions.shape[0]
    usable = np.zeros(count, dtype=np.bool_)
    for wheel in range(count):
        finite = math.isfinite(steering[wheel]) and math.isfinite(speed[wheel])
        sound = wheels.fault[wheel] == 0 and wheels.fault[count + wheel] == 0
        age_ns = now_ns - wheels.reply_ns[wheel_frames[wheel]]
        oldest_ns = max(oldest_ns, age_ns)
        usable[wheel] = finite and sound and age_ns * 1e-9 <= config.wheels_age_max_s
        if usable[wheel]:
            used_ns = max(used_ns, age_ns)
        if not finite:
            steering[wheel], speed[wheel] = 0.0, 0.0
            memory.wheels_rejected += 1
    equations = rolling_equations(config, positions, radius, steering, speed)
    return WheelReadings(equations, usable, used_ns * 1e-9, oldest_ns)


@compiled
def _publish(memory: VehicleFilterMemory, wheels: WheelReadings, now_ns: int, output: VehicleState) -> None:
    velocity = turned(matrix_of_quaternion(memory.orientation).T, memory.velocity)
    rate = memory.rate - memory.rate_bias
    output.stamp_ns = now_ns
    output.position[:] = memory.position
    output.orientation[:] = memory.orientation
    output.linear_velocity[:] = memory.velocity
    output.angular_velocity[:] = rate
    output.velocity[:] = velocity[:2]
    output.slip[:] = slip_ratios(wheels.equations, np.array([velocity[0], velocity[1], rate[2]]))
    for wheel in range(wheels.usable.shape[0]):
        output.slipping[wheel] = wheels.usable[wheel] and not memory.resting and memory.weight[wheel] < SLIPPING
    output.localization_age_ns = now_ns - memory.pose_stamp_ns
    output.localization_rejected = memory.poses_rejected
    output.localization_disputed = memory.poses_disputed
    output.imu_age_ns = now_ns - memory.imu_stamp_ns
    output.imu_rejected = memory.samples_rejected
    output.wheels_age_ns = wheels.oldest_ns
    output.wheels_rejected = memory.wheels_rejected
    output.yaw_rate_innovation = memory.yaw_rate_innovation
    output.covariance[:] = planar_covariance(memory)
    output.resting = memory.resting
