# SPDX-License-Identifier: Apache-2.0
"""Strictly prioritised inverse kinematics in the null spaces of the higher tasks (paper 000, eq 33-41, corrected)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

DAMPING = 1e-8
"""Added to J N (J N)^T, whose entries are of order one, so that a singular leg gives a bounded answer."""


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

    X_i = X_{i-1} + (J_i N_{i-1})^+ (demand_i - J_i X_{i-1}), N_i = N_{i-1} - (J_i N_{i-1})^+ (J_i N_{i-1}), with damped
    inverses.
    """
    size = tasks[0].jacobian.shape[1]
    motion = np.zeros((size, 3))
    null_space = np.eye(size)
    for jacobian, demand in tasks:
        free = jacobian @ null_space
        gram = free @ free.T
        gram.flat[:: gram.shape[0] + 1] += DAMPING
        answer = np.linalg.solve(gram, np.hstack((demand - jacobian @ motion, free)))
        motion += free.T @ answer[:, :3]
        null_space -= free.T @ answer[:, 3:]
    return motion
