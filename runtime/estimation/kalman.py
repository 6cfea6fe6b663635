# SPDX-License-Identifier: Apache-2.0
"""Error-state Kalman filter of the trunk: IMU prediction, standing feet as zero-velocity measurements, late poses.

Error state (15): position, velocity and rotation vector in odom, gyroscope bias and accelerometer bias in base, with
R_true = exp(theta) R. A standing foot is round and rolls: it is the contact *point*, not the foot's centre, that rests
(FORMULAS, pitfalls of paper 000), so its velocity includes the shank's absolute rate crossed with the foot's radius.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_kinematics import LegState
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import (
    matrix_of_quaternion,
    quaternion_of_vector,
    quaternion_product,
)
from runtime.models.vectors import skew, skews
from runtime.records import Record, boolean, float64_array

Array = npt.NDArray[np.float64]
SIZE = 15
POSITION, VELOCITY, ROTATION, RATE_BIAS, ACCELERATION_BIAS = (slice(i, i + 3) for i in range(0, SIZE, 3))


_IDENTITY = np.eye(SIZE)
HUBER = 2.0
"""Residuals beyond this many standard deviations widen their foot's deviation: a slipping foot counts less."""


class KalmanMemory(Record):
    """The filter's state."""

    started = boolean()
    position = float64_array(3, "m")
    velocity = float64_array(3, "m/s")
    orientation = float64_array(4, "", "x y z w")
    rate_bias = float64_array(3, "rad/s")
    acceleration_bias = float64_array(3, "m/s^2")
    covariance = float64_array(SIZE * SIZE)


class Measured(NamedTuple):
    """Innovation of a linear measurement: residual (m,), matrix (m, 15), variances (m,)."""

    residual: Array
    matrix: Array
    variance: Array


@cache
def _process_noise(config: KalmanConfig) -> Array:
    """Variance gained per second by each error state."""
    densities = (0.0, config.acceleration_noise, config.rate_noise, config.rate_walk, config.acceleration_walk)
    return np.repeat(np.square(densities), 3)


def start(memory: KalmanMemory, position: Array, orientation: Array) -> None:
    """Begin at a known pose, at rest."""
    memory.started = True
    memory.position, memory.velocity, memory.orientation = position, 0.0, orientation
    memory.rate_bias, memory.acceleration_bias = 0.0, 0.0
    spread = np.repeat((0.02, 0.05, 0.02, 0.01, 0.1), 3)
    memory.covariance = np.diag(spread**2).ravel()


def predict(memory: KalmanMemory, config: KalmanConfig, acceleration: Array, rate: Array, seconds: float) -> Array:
    """Propagate by one IMU sample; returns the rotation matrix after it."""
    rotation = matrix_of_quaternion(memory.orientation)
    force = rotation @ (acceleration - memory.acceleration_bias)
    turned = (rate - memory.rate_bias) * seconds
    gained = force * seconds
    gained[2] -= GRAVITY * seconds
    memory.position += memory.velocity * seconds + 0.5 * seconds * gained
    memory.velocity += gained
    orientation = quaternion_product(memory.orientation, quaternion_of_vector(turned))
    memory.orientation = orientation / np.sqrt(orientation @ orientation)

    transition = _IDENTITY.copy()
    transition[0, 3] = transition[1, 4] = transition[2, 5] = seconds
    transition[VELOCITY, ROTATION] = -seconds * skew(force)
    transition[VELOCITY, ACCELERATION_BIAS] = -seconds * rotation
    transition[ROTATION, RATE_BIAS] = -seconds * rotation
    covariance = transition @ memory.covariance.reshape(SIZE, SIZE) @ transition.T
    covariance.flat[:: SIZE + 1] += _process_noise(config) * seconds
    memory.covariance = covariance.ravel()
    return matrix_of_quaternion(memory.orientation)


def update(memory: KalmanMemory, measured: Measured) -> Array:
    """Apply a measurement; returns the error-state correction (15,)."""
    covariance = memory.covariance.reshape(SIZE, SIZE)
    cross = covariance @ measured.matrix.T
    innovation = measured.matrix @ cross
    innovation.flat[:: innovation.shape[0] + 1] += measured.variance
    _, gain, _ = lapack.dposv(innovation, cross.T)
    change = measured.residual @ gain
    covariance = covariance - cross @ gain
    memory.covariance = (0.5 * (covariance + covariance.T)).ravel()
    memory.position += change[POSITION]
    memory.velocity += change[VELOCITY]
    orientation = quaternion_product(quaternion_of_vector(change[ROTATION]), memory.orientation)
    memory.orientation = orientation / np.sqrt(orientation @ orientation)
    memory.rate_bias += change[RATE_BIAS]
    memory.acceleration_bias += change[ACCELERATION_BIAS]
    return change


def contact_measurement(
    memory: KalmanMemory,
    rotation: Array,
    rate: Array,
    legs: LegState,
    standing: npt.NDArray[np.intp],
    deviation: Array,
    normal: Array,
    foot_radius: float,
) -> Measured:
    """Contact points of standing feet at rest.

    Args:
        memory: the filter's state.
        rotation: trunk orientation.
        rate: angular velocity of the trunk, bias removed, in base.
        legs: kinematics.
        standing: indices of the feet, (n,).
        deviation: standard deviation of each foot's contact point velocity, (n,), m/s.
        normal: of the ground, in odom.
        foot_radius: m.
    """
    down = -foot_radius * (normal @ rotation)
    point = legs.position[standing] + down
    relative = legs.velocity[standing] + legs.shank_rate[standing] @ skew(down)
    turning = (relative - point @ skew(rate)) @ rotation.T
    count = standing.size
    matrix = np.zeros((count, 3, SIZE))
    matrix[:, :, VELOCITY] = _IDENTITY[:3, :3]
    matrix[:, :, ROTATION] = -skews(turning)
    matrix[:, :, RATE_BIAS] = rotation @ skews(point)
    residual = -(memory.velocity + turning)
    slip = np.sqrt(np.square(residual).sum(axis=1))
    trusted = np.maximum(deviation, slip / HUBER)
    return Measured(residual.ravel(), matrix.reshape(3 * count, SIZE), np.repeat(np.square(trusted), 3))


def pose_measurement(config: KalmanConfig, position_error: Array, yaw_error: float) -> Measured:
    """Position and yaw of the localisation sensor, as differences from the estimate at the pose's own stamp."""
    matrix = np.zeros((4, SIZE))
    matrix[0, 0] = matrix[1, 1] = matrix[2, 2] = 1.0
    matrix[3, 8] = 1.0
    variance = np.square([config.localization_position_m] * 3 + [config.localization_yaw_rad])
    return Measured(np.append(position_error, yaw_error), matrix, variance)
