# SPDX-License-Identifier: Apache-2.0
"""Strictly prioritised inverse kinematics in the null spaces of the higher tasks (paper 000, eq 33-41, corrected).

    X_i = X_{i-1} + (J_i N_{i-1})^+ (demand_i - J_i X_{i-1}),   N_i = null space projector of J_1 ... J_i

One QR factorisation of the stacked transposed Jacobians holds all of these: with [J_1; J_2; ...]^T = Q R, the
projection J_i N_{i-1} is R_ii^T Q_i^T, so that the recursion is the forward substitution of
R^T y = demand, and X = Q y.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]

SINGULAR_PIVOT = 0.05
"""Pivots of R below this are damped; the smallest of a bent leg is 0.1 and more, so that there nothing is."""
DAMPING = 0.04
"""Damping of a vanishing pivot: r acts as r + (DAMPING^2 (1 - (r / SINGULAR_PIVOT)^2)) / r."""
_SMALLEST_PIVOT = 1e-12


@compiled
def prioritised_motion(jacobian: Array, demand: Array) -> Array:
    """Position change, velocity and acceleration of the generalised coordinates, (n, 3).

    Args:
        jacobian: of all tasks, (m, n), those of the highest priority first; m <= n.
        demand: columns are the position error e, the velocity and the acceleration less the drift dJ/dt dq/dt, (m, 3).
    """
    rows, coordinates = jacobian.shape
    factors, scales = _reflected(jacobian)
    motion = np.zeros((coordinates, demand.shape[1]))
    for row in range(rows):
        motion[row] = demand[row]
        for above in range(row):
            motion[row] -= factors[row, above] * motion[above]
        motion[row] /= _damped(factors[row, row])
    for row in range(rows - 1, -1, -1):
        for column in range(motion.shape[1]):
            _reflect(factors, scales, row, motion[:, column])
    return motion


@compiled
def _reflected(jacobian: Array) -> tuple[Array, Array]:
    """Householder factors of J^T, transposed, and the scale of each reflection.

    Row k holds R_1k ... R_kk and then the reflection I - scale v v^T's vector v after its leading 1. LAPACK's routine
    does the same in three times the time at this size, and numpy's raises an exception on numbers that are not finite.
    """
    factors, rows, coordinates = jacobian.copy(), jacobian.shape[0], jacobian.shape[1]
    scales = np.zeros(rows)
    for row in range(rows):
        square = 0.0
        for inner in range(row, coordinates):
            square += factors[row, inner] ** 2
        if square == 0.0:
            continue
        pivot = -math.copysign(math.sqrt(square), factors[row, row])
        lead = factors[row, row] - pivot
        scales[row] = -lead / pivot
        factors[row, row] = pivot
        for inner in range(row + 1, coordinates):
            factors[row, inner] /= lead
        for below in range(row + 1, rows):
            _reflect(factors, scales, row, factors[below])
    return factors, scales


@compiled
def _reflect(factors: Array, scales: Array, row: int, vector: Array) -> None:
    """Apply the reflection that a row of the factors holds to a vector (n,), in place."""
    share = vector[row]
    for inner in range(row + 1, vector.size):
        share += factors[row, inner] * vector[inner]
    share *= scales[row]
    vector[row] -= share
    for inner in range(row + 1, vector.size):
        vector[inner] -= share * factors[row, inner]


@compiled
def _damped(pivot: float) -> float:
    """A pivot of R, kept away from zero."""
    safe = pivot if abs(pivot) > _SMALLEST_PIVOT else _SMALLEST_PIVOT
    activation = max(0.0, 1.0 - (safe / SINGULAR_PIVOT) ** 2)
    return safe + DAMPING**2 * activation / safe
