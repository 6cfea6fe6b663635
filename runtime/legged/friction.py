# SPDX-License-Identifier: Apache-2.0
"""The friction pyramid of standing feet as bounds and rows of a quadratic program (paper 000, eq 31)."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]


@compiled
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
    rows, side = np.zeros((4 * feet, 3 * feet)), friction * force_max
    lower, upper = np.full(7 * feet, -1e9), np.zeros(7 * feet)
    for foot in range(feet):
        for row in range(4):
            rows[4 * foot + row, 3 * foot + row // 2] = 1.0 - 2.0 * (row % 2)
            rows[4 * foot + row, 3 * foot + 2] = -friction
        for axis in range(3):
            lower[3 * foot + axis] = force_min if axis == 2 else -side
            upper[3 * foot + axis] = force_max if axis == 2 else side
    return rows, lower, upper


kept_pyramids = cache(friction_pyramids)
"""The same, built once for each number of feet."""
