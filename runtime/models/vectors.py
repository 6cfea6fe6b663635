# SPDX-License-Identifier: Apache-2.0
"""Cross products and the like of three-vectors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]


@compiled
def dot(a: Array, b: Array) -> float:
    """Scalar product of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def turned(matrix: Array, vector: Array) -> Array:
    """Product of a matrix (3, 3) and a vector (3,)."""
    x, y, z = vector[0], vector[1], vector[2]
    return np.array(
        [
            matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
            matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
            matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
        ]
    )


@compiled
def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,)."""
    ax, ay, az = a[0], a[1], a[2]
    bx, by, bz = b[0], b[1], b[2]
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


@compiled
def skew(vector: Array) -> Array:
    """Cross-product matrix (3, 3) of a: times a column b it gives a x b, and a row b times it gives b x a."""
    x, y, z = vector[0], vector[1], vector[2]
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@compiled
def total_moment(arms: Array, forces: Array) -> Array:
    """Sum of arm x force over the rows of two arrays (n, 3)."""
    moment = np.zeros(3)
    for row in range(arms.shape[0]):
        moment += cross(arms[row], forces[row])
    return moment


@compiled
def solve_three(matrix: Array, right: Array) -> Array:
    """Solution x of matrix x = right, 3 by 3 and regular, by cofactors."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    g, h, i = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    x, y, z = right[0], right[1], right[2]
    ei, fg, dh = e * i - f * h, f * g - d * i, d * h - e * g
    scale = 1.0 / (a * ei + b * fg + c * dh)
    return np.array(
        [
            scale * (ei * x + (c * h - b * i) * y + (b * f - c * e) * z),
            scale * (fg * x + (a * i - c * g) * y + (c * d - a * f) * z),
            scale * (dh * x + (b * g - a * h) * y + (a * e - b * d) * z),
        ]
    )
