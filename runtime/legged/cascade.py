# SPDX-License-Identifier: Apache-2.0
"""Strictly prioritised inverse kinematics in the null spaces of the higher tasks (paper 000, eq 33-41, corrected).

    X_i = X_{i-1} + (J_i N_{i-1})^+ (demand_i - J_i X_{i-1}),   N_i = null space projector of J_1 ... J_i

One QR factorisation of the stacked transposed Jacobians holds all of these: with [J_1; J_2; ...]^T = Q R, the
projection J_i N_{i-1} is R_ii^T Q_i^T, so that the recursion is the forward substitution of
R^T y = demand, and X = Q y.
"""

from __future__ import annotations

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

    All is NaN if the Jacobian is not finite.
    """
    rows, coordinates = jacobian.shape
    if not np.isfinite(jacobian).all():
        return np.full((coordinates, demand.shape[1]), np.nan)
    basis, factor = np.linalg.qr(jacobian.T)
    solution = demand.copy()
    for row in range(rows):
        for above in range(row):
            solution[row] -= factor[above, row] * solution[above]
        solution[row] /= _damped(factor[row, row])
    return np.ascontiguousarray(basis) @ solution


@compiled
def _damped(pivot: float) -> float:
    """A pivot of R, kept away from zero."""
    safe = pivot if abs(pivot) > _SMALLEST_PIVOT else _SMALLEST_PIVOT
    activation = max(0.0, 1.0 - (safe / SINGULAR_PIVOT) ** 2)
    return safe + DAMPING**2 * activation / safe
