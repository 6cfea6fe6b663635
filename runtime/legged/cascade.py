# SPDX-License-Identifier: Apache-2.0
"""Strictly prioritised inverse kinematics in the null spaces of the higher tasks (paper 000, eq 33-41, corrected).

    X_i = X_{i-1} + (J_i N_{i-1})^+ (demand_i - J_i X_{i-1}),   N_i = null space projector of J_1 ... J_i

One QR factorisation of the stacked transposed Jacobians holds all of these: with [J_1; J_2; ...]^T = Q R, the
projection J_i N_{i-1} is R_ii^T Q_i^T, so that the recursion is the forward substitution of
R^T y = demand, and X = Q y.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

Array = npt.NDArray[np.float64]

SINGULAR_PIVOT = 0.05
"""Pivots of R below this are damped; the smallest of a bent leg is 0.1 and more, so that there nothing is."""
DAMPING = 0.04
"""Damping of a vanishing pivot: r acts as r + (DAMPING^2 (1 - (r / SINGULAR_PIVOT)^2)) / r."""
_SMALLEST_PIVOT = 1e-12


class MotionTask(NamedTuple):
    """One task of m rows on n generalised coordinates.

    Attributes:
        jacobian: (m, n).
        demand: columns are the position error e, the velocity and the acceleration less the drift dJ/dt dq/dt, (m, 3).
    """

    jacobian: Array
    demand: Array


def prioritised_motion(tasks: Sequence[MotionTask]) -> Array:
    """Position change, velocity and acceleration of the generalised coordinates, (n, 3), tasks with the highest first.

    The rows of all tasks together are at most as many as the coordinates.
    """
    stacked = np.concatenate([task.jacobian for task in tasks])
    demand = np.concatenate([task.demand for task in tasks])
    rows = stacked.shape[0]
    factors, reflectors, _, _ = lapack.dgeqrf(stacked.T)
    pivots = factors.diagonal()
    safe = np.where(np.abs(pivots) > _SMALLEST_PIVOT, pivots, _SMALLEST_PIVOT)
    activation = np.maximum(0.0, 1.0 - np.square(safe / SINGULAR_PIVOT))
    factors.flat[: rows * (rows + 1) : rows + 1] = safe + DAMPING**2 * activation / safe
    answer = np.zeros((stacked.shape[1], demand.shape[1]))
    answer[:rows], _ = lapack.dtrtrs(factors[:rows], demand, lower=0, trans=1)
    motion, _, _ = lapack.dormqr("L", "N", factors, reflectors, answer, 64 * rows)
    return np.asarray(motion)
