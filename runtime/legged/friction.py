# SPDX-License-Identifier: Apache-2.0
"""The friction pyramid of standing feet as bounds and rows of a quadratic program (paper 000, eq 31)."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@cache
def friction_pyramids(feet: int, friction: float, force_min: float, force_max: float) -> tuple[Array, Array, Array]:
    """Rows |f_t| <= mu f_n and bounds f_min <= f_n <= f_max.

    Args:
        feet: number of forces, each (tangent, tangent, normal) in the stance plane's axes.
        friction: mu of the pyramid; the coefficient of the cone over sqrt(2) keeps the pyramid within it.
        force_min: of the normal force, N.
        force_max: of the normal force, N.

    Returns:
        The rows (4 n, 3 n), and the lower and upper bounds (7 n,) of the variables and then of the rows.
    """
    rows = np.array([[1.0, 0.0, -friction], [-1.0, 0.0, -friction], [0.0, 1.0, -friction], [0.0, -1.0, -friction]])
    side = friction * force_max
    lower = np.concatenate((np.tile([-side, -side, force_min], feet), np.full(4 * feet, -1e9)))
    upper = np.concatenate((np.tile([side, side, force_max], feet), np.zeros(4 * feet)))
    return np.kron(np.eye(feet), rows), lower, upper
