# SPDX-License-Identifier: Apache-2.0
"""Cross products of three-vectors, fast for the few at a time that a control tick needs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SKEW = np.zeros((3, 9))
_SKEW[0, 7] = _SKEW[1, 2] = _SKEW[2, 3] = 1.0
_SKEW[0, 5] = _SKEW[1, 6] = _SKEW[2, 1] = -1.0


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,)."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def skew(vector: Array) -> Array:
    """Cross-product matrix (3, 3) of a: times a column b it gives a x b, and a row b times it gives b x a."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def skews(vectors: Array) -> Array:
    """The same for vectors (n, 3), (n, 3, 3)."""
    return (vectors @ _SKEW).reshape(-1, 3, 3)


def total_moment(arms: Array, forces: Array) -> Array:
    """Sum of arm x force over the rows of two arrays (n, 3)."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = (arms.T @ forces).tolist()
    return np.array([yz - zy, zx - xz, xy - yx])


def solve_three(matrix: Array, right: Array) -> Array:
    """Solution x of matrix x = right, 3 by 3 and regular, by cofactors."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    x, y, z = right.tolist()
    ei, fg, dh = e * i - f * h, f * g - d * i, d * h - e * g
    scale = 1.0 / (a * ei + b * fg + c * dh)
    return np.array(
        [
            scale * (ei * x + (c * h - b * i) * y + (b * f - c * e) * z),
            scale * (fg * x + (a * i - c * g) * y + (c * d - a * f) * z),
            scale * (dh * x + (b * g - a * h) * y + (a * e - b * d) * z),
        ]
    )
