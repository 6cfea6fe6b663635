# SPDX-License-Identifier: Apache-2.0
"""The limits of joints and trunk. Pure functions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.safety.config import SafetyConfig
from runtime.signals import JointCommand

Array = npt.NDArray[np.float64]


def joint_bounds(config: SafetyConfig) -> tuple[Array, Array]:
    """Lowest and highest positions of the twelve joints, ab/ad mirrored on the right legs."""
    low, high = np.array(config.position_min_rad), np.array(config.position_max_rad)
    right_low, right_high = low.copy(), high.copy()
    right_low[0], right_high[0] = -high[0], -low[0]
    return np.concatenate((low, right_low) * 2), np.concatenate((high, right_high) * 2)


@compiled
def tilt(orientation: Array) -> float:
    """Angle between the trunk's z axis and the vertical, rad; NaN if the orientation is not finite."""
    if not np.isfinite(orientation).all():
        return math.nan
    x, y = orientation[0], orientation[1]
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))


@compiled
def is_finite(command: JointCommand) -> bool:
    """Whether every number of a command is finite."""
    return bool(
        np.isfinite(command.position).all()
        and np.isfinite(command.velocity).all()
        and np.isfinite(command.effort).all()
        and np.isfinite(command.stiffness).all()
        and np.isfinite(command.damping).all()
    )


@compiled
def within(wanted: Array, low: Array, high: Array, limited: Array) -> int:
    """Put the values within their bounds into `limited`; returns how many had to be altered."""
    altered = 0
    for row in range(wanted.shape[0]):
        limited[row] = min(max(wanted[row], low[row]), high[row])
        altered += limited[row] != wanted[row]
    return altered
