# SPDX-License-Identifier: Apache-2.0
"""Error-state Kalman filter of the trunk: IMU prediction, standing feet as zero-velocity measurements, late poses.

Error state (15): position, velocity and rotation vector in odom, gyroscope bias and accelerometer bias in base, with
R_true = exp(theta) R. A standing foot is round and rolls: it is the contact *point*, not the foot's centre, that rests
(FORMULAS, pitfalls of paper 000), so its velocity includes the shank's absolute rate crossed with the foot's radius.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.estimation.kalman_config import InertialFilterConfig
from runtime.models.leg_kinematics import LegState
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import (
    matrix_of_quaternion,
    normalized,
    quaternion_of_vector,
    quaternion_product,
)
from runtime.models.vectors import cross, dot, skew, turned
from runtime.optimization.linear import solve_positive
from runtime.records import Record, boolean, float64_array

Array = npt.NDArray[np.float64]
SIZE = 15
POSITION, VELOCITY, ROTATION, RATE_BIAS, ACCELERATION_BIAS = (slice(i, i + 3) for i in range(0, SIZE, 3))

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


def start(memory: KalmanMemory, position: Array, orientation: Array) -> None:
    """Begin at a known pose, at rest."""
    memory.started = True
    memory.position, memory.velocity, memory.orientation = position, 0.0, orientation
    memory.rate_bias, memory.acceleration_bias = 0.0, 0.0
    spread = np.repeat((0.02, 0.05, 0.02, 0.01, 0.1), 3)
    memory.covariance = np.diag(spread**2).ravel()


@compiled
def predict(
    memory: KalmanMemory, config: InertialFilterConfig, acceleration: Array, rate: Array, seconds: float
) -> Array:
    """Propagate by one IMU sample; returns the rotation matrix after it.

    Args:
        memory: the filter's state.
        config: noise.
        acceleration: specific force, in base, m/s^2.
        rate: angular velocity, in base, rad/s.
        seconds: since the sample before.
    """
    rotation = matrix_of_quaternion(memory.orientation)
    force = turned(rotation, acceleration - memory.acceleration_bias)
    gained = force * seconds
    gained[2] -= GRAVITY * seconds
    memory.position += memory.velocity * seconds + 0.5 * seconds * gained
    memory.velocity += gained
    turn = quaternion_of_vector((rate - memory.rate_bias) * seconds)
    memory.orientation[:] = normalized(quaternion_product(memory.orientation, turn))

    transition = np.eye(SIZE)
    transition[0, 3] = transition[1, 4] = transition[2, 5] = seconds
    transition[3:6, 6:9] = -seconds * skew(force)
    transition[3:6, 12:15] = -seconds * rotation
    transition[6:9, 9:12] = -seconds * rotation
    covariance = transition @ memory.covariance.reshape(SIZE, SIZE) @ transition.T
    densities = (0.0, config.acceleration_noise, config.rate_noise, config.rate_walk, config.acceleration_walk)
    for state in range(SIZE):
        covariance[state, state] += densities[state // 3] ** 2 * seconds
    memory.covariance[:] = covariance.ravel()
    return matrix_of_quaternion(memory.orientation)


@compiled
def update(memory: KalmanMemory, measured: Measured) -> Array:
    """Apply a measurement; returns the error-state correction (15,)."""
    before = memory.covariance.reshape(SIZE, SIZE)
    cross_covariance = measured.matrix @ before
    innovation = cross_covariance @ measured.matrix.T
    for row in range(measured.variance.shape[0]):
        innovation[row, row] += measured.variance[row]
    gain = solve_positive(innovation, cross_covariance)
    change = measured.residual @ gain
    after = before - cross_covariance.T @ gain
    memory.covariance[:] = (0.5 * (after + after.T)).ravel()
    memory.position += change[0:3]
    memory.velocity += change[3:6]
    memory.orientation[:] = normalized(quaternion_product(quaternion_of_vector(change[6:9]), memory.orientation))
    memory.rate_bias += change[9:12]
    memory.acceleration_bias += change[12:15]
    return change


@compiled
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
    count = standing.shape[0]
    residual, matrix, variance = np.empty(3 * count), np.zeros((3 * count, SIZE)), np.empty(3 * count)
    down = -foot_radius * turned(rotation.T, normal)
    for row in range(count):
        foot = standing[row]
        point = legs.position[foot] + down
        relative = legs.velocity[foot] + cross(legs.shank_rate[foot], down)
        moving = turned(rotation, relative + cross(rate, point))
        rows = slice(3 * row, 3 * row + 3)
        residual[rows] = -(memory.velocity + moving)
        matrix[rows, 6:9] = -skew(moving)
        for axis in range(3):
            matrix[3 * row + axis, 3 + axis] = 1.0
            # each row of R [p]x is the row of R crossed with p
            matrix[3 * row + axis, 9:12] = cross(rotation[axis], point)
        slip = math.sqrt(dot(residual[rows], residual[rows]))
        variance[rows] = max(deviation[row], slip / HUBER) ** 2
    return Measured(residual, matrix, variance)


@compiled
def pose_measurement(
    config: InertialFilterConfig, position_error: Array, yaw_error: float, travelled: Array
) -> Measured:
    """Position and yaw of the localisation sensor, as differences from the estimate at the pose's own stamp.

    Args:
        config: noise.
        position_error: differences, (3,), m.
        yaw_error: difference, rad.
        travelled: since then, in odom: a wrong direction turned this way too, so that the position was less wrong.
    """
    residual, matrix, variance = np.empty(4), np.zeros((4, SIZE)), np.empty(4)
    residual[:3], residual[3] = position_error, yaw_error
    matrix[0, 0] = matrix[1, 1] = matrix[2, 2] = 1.0
    matrix[:3, 6:9] = skew(travelled)
    matrix[3, 8] = 1.0
    variance[:3], variance[3] = config.localization_position_m**2, config.localization_yaw_rad**2
    return Measured(residual, matrix, variance)
