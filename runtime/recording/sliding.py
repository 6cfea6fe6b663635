# SPDX-License-Identifier: Apache-2.0
"""How a vehicle went over a patch of slippery ground: functions on the true pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.recording.metrics import Array, or_none

ROLLING_MPS = 0.3
"""Below this speed the direction of motion says nothing."""


@dataclass(frozen=True)
class Sliding:
    """Over a patch.

    Attributes:
        side_slip_max_rad: largest angle between the direction of motion and the vehicle's axis, whole run.
        speed_entry_mps: when its centre came onto the patch; NaN if it never did, as are the others.
        speed_least_mps: the lowest on it.
        speed_mean_mps: averaged over the samples on it.
    """

    side_slip_max_rad: float
    speed_entry_mps: float
    speed_least_mps: float
    speed_mean_mps: float

    def summary(self) -> dict[str, Any]:
        """The entry `patch` of summary.json."""
        return {name: or_none(getattr(self, name)) for name in self.__dataclass_fields__}


def sliding(t: Array, xy: Array, yaw: Array, on_patch: npt.NDArray[np.bool_]) -> Sliding:
    """Judge how a vehicle moved.

    Args:
        t: sample times, rising, s.
        xy: true position of its centre, n x 2, m.
        yaw: true yaw, rad.
        on_patch: whether the centre was over the patch, of each sample.
    """
    if len(t) < 2:
        return Sliding(0.0, np.nan, np.nan, np.nan)
    velocity = np.diff(xy, axis=0) / np.diff(t)[:, None]
    speed, there = np.hypot(*velocity.T), on_patch[1:]
    fast = speed >= ROLLING_MPS
    slip = side_slip(velocity[fast], yaw[1:][fast])
    over = speed[there] if there.any() else np.full(1, np.nan)
    return Sliding(
        side_slip_max_rad=float(np.abs(slip).max(initial=0.0)),
        speed_entry_mps=float(over[0]),
        speed_least_mps=float(over.min()),
        speed_mean_mps=float(over.mean()),
    )


def side_slip(velocity: Array, yaw: Array) -> Array:
    """Angle from a vehicle's axis to its direction of motion, forwards or backwards, rad in [-pi/2, pi/2].

    Args:
        velocity: in the world, n x 2.
        yaw: n.
    """
    forward = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
    lateral = velocity[:, 1] * np.cos(yaw) - velocity[:, 0] * np.sin(yaw)
    return np.asarray(np.arctan2(lateral * np.sign(forward), np.abs(forward)))
