# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter of `kalman` for a vehicle: its steered wheels give the velocity, standing still the biases.

State, prediction, late poses and their rejection are those of every robot (`kalman`, `localization`). The wheels' twist
is compared with the velocity in base, which turns with the slope under the vehicle, and with the gyroscope's yaw rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.estimation import kalman
from runtime.estimation.inertial_input import InertialMemory, StepMemory
from runtime.estimation.localization import LocalizationMemory
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.estimation.wheel_odometry import FAINT, Equations, Odometry, twist_of_wheels
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import quaternion_of_vector, quaternion_of_yaw, quaternion_product
from runtime.models.vectors import cross, dot, turned
from runtime.optimization.linear import lower_factor, solve_lower
from runtime.records import boolean, float64, float64_array, int64, uint32

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

RATE_UNKNOWN = 1e3
"""Deviation of a gyroscope that is silent, rad/s."""
PLANAR = (0, 1, 8)
"""x, y and yaw within the error state."""


class VehicleFilterMemory(LocalizationMemory, StepMemory, InertialMemory):
    """The filter's state, and what it last took up."""

    rate_before = float64_array(3, "rad/s", "of the step before")
    acceleration_before = float64_array(3, "m/s^2", "of the step before")
    rolling = float64_array("wheel", "m/s", "speeds of the wheels, averaged")
    moved_ns = int64("ns", "when the vehicle was last seen to move")
    resting = boolean()
    weight = float64_array("wheel", "", "of each wheel in the odometry, 0 if it gave no reading")
    wheels_rejected = uint32("", "readings that were not finite")
    wheels_twist = float64_array(3, "m/s, m/s, rad/s", "of the odometry")
    yaw_rate_innovation = float64("rad/s", "yaw rate of the wheels less that of the gyroscope")


class WheelReadings(NamedTuple):
    """What the wheels said last.

    Attributes:
        equations: of all wheels.
        usable: wheels whose reading is recent and sound, (4,).
        age_s: of the oldest usable reading.
        oldest_ns: age of the oldest of all.
    """

    equations: Equations
    usable: Mask
    age_s: float
    oldest_ns: int


@compiled
def leveled(yaw: float, acceleration: Array) -> Array:
    """Orientation of a resting vehicle: a heading, and the tilt that its specific force shows."""
    x, y, z = acceleration[0], acceleration[1], acceleration[2]
    pitch, roll = math.atan2(-x, math.sqrt(y * y + z * z)), math.atan2(y, z)
    turn = quaternion_product(quaternion_of_yaw(yaw), quaternion_of_vector(np.array([0.0, pitch, 0.0])))
    return quaternion_product(turn, quaternion_of_vector(np.array([roll, 0.0, 0.0])))


@compiled
def motion_sample(memory: VehicleFilterMemory, rotation: Array, fresh: bool) -> tuple[Array, Array]:
    """Specific force and angular velocity to predict by: their means over the step, or what replaces a silent IMU.

    Without samples the vehicle is taken to go on as its wheels say, without acceleration.
    """
    if not fresh:
        memory.rate[:] = memory.rate_bias
        memory.rate[2] += memory.wheels_twist[2]
        velocity, rate = turned(rotation.T, memory.velocity), memory.rate - memory.rate_bias
        memory.acceleration[:] = memory.acceleration_bias + GRAVITY * rotation[2] + cross(rate, velocity)
    acceleration = 0.5 * (memory.acceleration + memory.acceleration_before)
    rate = 0.5 * (memory.rate + memory.rate_before)
    memory.acceleration_before[:], memory.rate_before[:] = memory.acceleration, memory.rate
    return acceleration, rate


@compiled
def rests(
    config: VehicleFilterConfig, memory: VehicleFilterMemory, wheels: WheelReadings, now_ns: int, seconds: float
) -> bool:
    """Whether wheels and gyroscope have shown no motion for long enough."""
    share = min(1.0, seconds / config.rest_filter_s)
    still = wheels.usable.any()
    for wheel in range(wheels.usable.shape[0]):
        if wheels.usable[wheel]:
            memory.rolling[wheel] += share * (wheels.equations.right[2 * wheel] - memory.rolling[wheel])
            still = still and abs(memory.rolling[wheel]) <= config.rest_speed_mps
    rate = memory.rate - memory.rate_bias
    if not still or dot(rate, rate) > config.rest_rate_radps**2:
        memory.moved_ns = now_ns
    memory.resting = (now_ns - memory.moved_ns) * 1e-9 >= config.rest_s
    return memory.resting


@compiled
def rest_measurement(
    config: VehicleFilterConfig, memory: VehicleFilterMemory, seconds: float, fresh: bool
) -> kalman.Measured:
    """No velocity, and no rate but the gyroscope's bias."""
    rows = 6 if fresh else 3
    residual, matrix, variance = np.empty(rows), np.zeros((rows, kalman.SIZE)), np.empty(rows)
    for axis in range(rows):
        if axis < 3:
            residual[axis], matrix[axis, 3 + axis] = -memory.velocity[axis], 1.0
            variance[axis] = config.rest_velocity_mps**2
        else:
            residual[axis], matrix[axis, 6 + axis] = memory.rate[axis - 3] - memory.rate_bias[axis - 3], 1.0
            variance[axis] = config.rate_noise**2 / seconds
    return kalman.Measured(residual, matrix, variance)


@compiled
def wheel_measurement(
    config: VehicleFilterConfig,
    memory: VehicleFilterMemory,
    rotation: Array,
    wheels: WheelReadings,
    seconds: float,
    fresh: bool,
) -> kalman.Measured:
    """The wheels' twist, and no velocity off the ground; what the wheels do not agree on is uncertain.

    Args:
        config: deviations.
        memory: the filter's state, to which the odometry is noted.
        rotation: of base in odom.
        wheels: at least two readings.
        seconds: of the step.
        fresh: whether the gyroscope is to be gone by.
    """
    velocity, rate = turned(rotation.T, memory.velocity), memory.rate - memory.rate_bias
    expected = np.array([velocity[0], velocity[1], rate[2]])
    matrix = np.zeros((4, kalman.SIZE))
    for axis in range(3):
        row = axis if axis < 2 else 3
        matrix[row, 3:6] = rotation[:, axis]
        matrix[row, 6:9] = cross(rotation[:, axis], memory.velocity)
    matrix[2, 11] = -1.0
    covariance = memory.covariance.reshape(kalman.SIZE, kalman.SIZE)
    spread = matrix[:3] @ covariance @ matrix[:3].T
    spread[2, 2] += config.rate_noise**2 / seconds if fresh else RATE_UNKNOWN**2
    odometry = twist_of_wheels(config, wheels.equations, wheels.usable, expected, spread)
    _note(memory, odometry, expected)

    gained = memory.acceleration - memory.acceleration_bias - GRAVITY * rotation[2] - cross(rate, velocity)
    residual = np.zeros((4, 1))
    for row in range(3):
        residual[row, 0] = odometry.twist[row] - expected[row]
    residual[0, 0] += gained[0] * wheels.age_s
    residual[1, 0] += gained[1] * wheels.age_s
    residual[3, 0] = -velocity[2]
    uncertainty = _uncertainty(config, odometry, spread, residual[:3], seconds, fresh)
    factor = lower_factor(uncertainty)
    return kalman.Measured(solve_lower(factor, residual).ravel(), solve_lower(factor, matrix), np.ones(4))


@compiled
def _uncertainty(
    config: VehicleFilterConfig, odometry: Odometry, spread: Array, residual: Array, seconds: float, fresh: bool
) -> Array:
    """Covariance of the measurement (4, 4): of the twist, wider if all wheels together do what cannot be; and of vz."""
    twist, vx, vy = odometry.covariance.copy(), odometry.twist[0], odometry.twist[1]
    together = config.twist_mps**2 + config.twist_share**2 * (vx * vx + vy * vy)
    twist[0, 0] += together
    twist[1, 1] += together
    twist[2, 2] += config.twist_radps**2
    whitened = solve_lower(lower_factor(twist + spread), residual).ravel()
    excess = (1.0 + dot(whitened, whitened) / config.twist_gate**2) ** 2
    uncertainty = np.zeros((4, 4))
    uncertainty[:3, :3] = excess * twist
    uncertainty[2, 2] += config.rate_noise**2 / seconds if fresh else RATE_UNKNOWN**2
    uncertainty[3, 3] = config.vertical_mps**2
    return uncertainty


@compiled
def _note(memory: VehicleFilterMemory, odometry: Odometry, expected: Array) -> None:
    """Keep what the wheels said; if all of them slip, they said nothing of the yaw rate that replaces a silent IMU."""
    memory.weight[:] = odometry.weight
    memory.yaw_rate_innovation = odometry.twist[2] - expected[2]
    if odometry.weight.max() > FAINT:
        memory.wheels_twist[:] = odometry.twist


@compiled
def planar_covariance(memory: kalman.KalmanMemory) -> Array:
    """Covariance of x, y and yaw, row by row, (9,)."""
    covariance, planar = memory.covariance.reshape(kalman.SIZE, kalman.SIZE), np.empty(9)
    for row, state in enumerate(PLANAR):
        for column, other in enumerate(PLANAR):
            planar[3 * row + column] = covariance[state, other]
    return planar
