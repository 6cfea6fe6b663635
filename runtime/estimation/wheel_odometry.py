# SPDX-License-Identifier: Apache-2.0
"""The planar twist of a vehicle from the angles and speeds of its steered wheels. Pure functions.

A wheel at (x, y) that rolls without slip moves at r s along its direction and at 0 across it (FORMULAS, paper 002):

    r s = (vx - w y) cos d + (vy + w x) sin d,      0 = -(vx - w y) sin d + (vy + w x) cos d

Four wheels give eight equations for three unknowns, solved by weighted least squares. A wheel that slips contradicts
the others, and before that what is expected: both its equations count less, by Geman and McClure's weight
(1 + e^2 / g^2)^-2 of its residual e in standard deviations and the gate g. The first weights come from what is
expected, and the next from what wheels and expectation say together, so that even most of the wheels may slip at once.
What is expected has no other part in the twist.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.models.vectors import dot, solve_three, turned
from runtime.optimization.linear import solve_positive

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

ROUNDS = 4
"""Of reweighting."""
SLIPPING = 0.25
"""Weight below which a wheel is said to slip: that of a residual at the gate."""
FAINT = 1e-6
"""Least weight: if all wheels slip, the twist is vague but still a number."""


class Equations(NamedTuple):
    """Two equations of each wheel, along it and across it.

    Attributes:
        matrix: (2 n, 3), of the twist (vx, vy, w).
        right: (2 n,), m/s.
        variance: (2 n,).
    """

    matrix: Array
    right: Array
    variance: Array


class Odometry(NamedTuple):
    """What the wheels say together.

    Attributes:
        twist: vx, vy, w of the vehicle's centre, in base, (3,).
        covariance: of the twist, (3, 3).
        weight: of each wheel, 1 if it rolls just as the others say, 0 if it gives no reading, (4,).
    """

    twist: Array
    covariance: Array
    weight: Array


@compiled
def rolling_equations(
    config: VehicleFilterConfig, positions: Array, radius: float, steering: Array, speed: Array
) -> Equations:
    """The equations of all wheels.

    Args:
        config: deviations.
        positions: of the wheels in base, (n, 2), m.
        radius: of the wheels, m.
        steering: angles, positive to the left, (n,), rad.
        speed: about the axles, (n,), rad/s.
    """
    count = positions.shape[0]
    matrix, right, variance = np.empty((2 * count, 3)), np.zeros(2 * count), np.empty(2 * count)
    for wheel in range(count):
        x, y, rolling = positions[wheel, 0], positions[wheel, 1], radius * speed[wheel]
        c, s = math.cos(steering[wheel]), math.sin(steering[wheel])
        along, across = 2 * wheel, 2 * wheel + 1
        matrix[along, 0], matrix[along, 1], matrix[along, 2] = c, s, s * x - c * y
        matrix[across, 0], matrix[across, 1], matrix[across, 2] = -s, c, c * x + s * y
        right[along] = rolling
        variance[along] = config.rolling_mps**2 + (config.rolling_share * rolling) ** 2
        variance[across] = config.lateral_mps**2 + (config.steering_rad * rolling) ** 2
    return Equations(matrix, right, variance)


@compiled
def twist_of_wheels(
    config: VehicleFilterConfig, equations: Equations, usable: Mask, expected: Array, spread: Array
) -> Odometry:
    """The weighted least-squares twist.

    Args:
        config: the gate of slip.
        equations: of the wheels.
        usable: wheels that gave a reading, (4,).
        expected: twist, (3,).
        spread: covariance of that, (3, 3).
    """
    weight = _weights(config, equations, usable, expected, spread)
    known, certain = solve_positive(spread, np.eye(3)), np.zeros((3, 3))
    for _ in range(ROUNDS):
        information, sum_of_right = _normal_equations(equations, weight)
        together = solve_three(information + known, sum_of_right + turned(known, expected))
        weight = _weights(config, equations, usable, together, certain)
    information, sum_of_right = _normal_equations(equations, weight)
    return Odometry(solve_three(information, sum_of_right), solve_positive(information, np.eye(3)), weight)


@compiled
def slip_ratios(equations: Equations, twist: Array) -> Array:
    """(Rolling speed - ground speed along the wheel) / the larger of both, of each wheel, (n,); 0 at rest."""
    count = equations.right.shape[0] // 2
    ratio = np.zeros(count)
    for wheel in range(count):
        rolling, ground = equations.right[2 * wheel], dot(equations.matrix[2 * wheel], twist)
        larger = max(abs(rolling), abs(ground))
        if larger > 3.0 * math.sqrt(equations.variance[2 * wheel]):
            ratio[wheel] = (rolling - ground) / larger
    return ratio


@compiled
def _weights(config: VehicleFilterConfig, equations: Equations, usable: Mask, twist: Array, spread: Array) -> Array:
    """Weight of each wheel by its residuals to a twist that is uncertain by a covariance (3, 3)."""
    weight = np.zeros(usable.shape[0])
    for wheel in range(usable.shape[0]):
        square = 0.0
        for row in range(2 * wheel, 2 * wheel + 2):
            direction = equations.matrix[row]
            residual = equations.right[row] - dot(direction, twist)
            square += residual**2 / (equations.variance[row] + dot(direction, turned(spread, direction)))
        if usable[wheel]:
            weight[wheel] = max(FAINT, (1.0 + square / config.slip_gate**2) ** -2)
    return weight


@compiled
def _normal_equations(equations: Equations, weight: Array) -> tuple[Array, Array]:
    """A^T W A (3, 3) and A^T W b (3,)."""
    information, sum_of_right = np.zeros((3, 3)), np.zeros(3)
    for row in range(equations.right.shape[0]):
        share = weight[row // 2] / equations.variance[row]
        for i in range(3):
            sum_of_right[i] += share * equations.matrix[row, i] * equations.right[row]
            for j in range(3):
                information[i, j] += share * equations.matrix[row, i] * equations.matrix[row, j]
    return information, sum_of_right
