# SPDX-License-Identifier: Apache-2.0
"""Small dense linear systems for compiled kernels.

numpy's solvers raise an exception on data that are singular or not finite; in a control loop such data have to come out
as numbers that are not finite, for the checks behind them to find.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]


@compiled
def lower_factor(matrix: Array) -> Array:
    """Cholesky factor L of matrix = L L^T (n, n); NaN where the matrix is not positive definite."""
    size = matrix.shape[0]
    factor = np.zeros((size, size))
    for row in range(size):
        for column in range(row + 1):
            rest = matrix[row, column]
            for inner in range(column):
                rest -= factor[row, inner] * factor[column, inner]
            factor[row, column] = math.sqrt(rest) if row == column else rest / factor[column, column]
    return factor


@compiled
def solve_lower(factor: Array, right: Array) -> Array:
    """Solution X (n, m) of factor X = right, the factor (n, n) a lower triangle."""
    size, columns = right.shape
    solution = right.copy()
    for row in range(size):
        for inner in range(row):
            for column in range(columns):
                solution[row, column] -= factor[row, inner] * solution[inner, column]
        for column in range(columns):
            solution[row, column] /= factor[row, row]
    return solution


@compiled
def solve_positive(matrix: Array, right: Array) -> Array:
    """Solution X (n, m) of matrix X = right by Cholesky; NaN where the matrix (n, n) is not positive definite."""
    size, columns = right.shape
    factor = lower_factor(matrix)
    solution = solve_lower(factor, right)
    for row in range(size - 1, -1, -1):
        for inner in range(row + 1, size):
            for column in range(columns):
                solution[row, column] -= factor[inner, row] * solution[inner, column]
        for column in range(columns):
            solution[row, column] /= factor[row, row]
    return solution
