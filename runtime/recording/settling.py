# SPDX-License-Identifier: Apache-2.0
"""How a vehicle came to its path from a start beside it, and how it turned in place: functions on the true pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.recording.metrics import AnyPath, Array, Projection, first_motion, project, time_average

SETTLED_M = 0.05
WINDOW_S = 25.0
"""Of paper 002's straight experiment."""
APPROACH_S = 12.0
"""Of its curve experiment: what comes before is told apart from the rest."""
TURNED_RAD, STAYED_M = math.radians(5.0), 0.15


@dataclass(frozen=True)
class Settling:
    """From beside the path onto it; times count from first motion.

    Attributes:
        time_s: from when on the vehicle stays within 5 cm of the path; NaN if it does not.
        overshoot_m: how far it got to the other side.
        mean_25_s_m: mean distance over the first 25 s.
        mean_approach_m: mean distance over the first 12 s.
        mean_after_m: mean distance after that; NaN if there is nothing after that.
    """

    time_s: float
    overshoot_m: float
    mean_25_s_m: float
    mean_approach_m: float
    mean_after_m: float

    def summary(self) -> dict[str, Any]:
        """The entry `settling` of summary.json."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {name: value if math.isfinite(value) else None for name, value in values.items()}


def settling(t: Array, xy: Array, path: AnyPath) -> Settling:
    """Judge how a vehicle came to its path.

    Args:
        t: sample times, rising, s.
        xy: true position, n x 2, m.
        path: the path.
    """
    begin = first_motion(xy[:, 0], xy[:, 1])
    if begin is None:
        return Settling(math.nan, math.nan, math.nan, math.nan, math.nan)
    t, xy = t[begin:] - t[begin], xy[begin:]
    return settling_of(t, project(xy[:, 0], xy[:, 1], np.zeros(len(t)), path))


def settling_of(t: Array, seen: Projection) -> Settling:
    """Judge how a vehicle that moves from the first sample on came to its path.

    Args:
        t: sample times, rising from 0, s.
        seen: its true poses against the path.
    """
    side = math.copysign(1.0, seen.lateral_error[0])
    away = np.flatnonzero(seen.distance > SETTLED_M)
    last = int(away[-1]) if len(away) else -1
    return Settling(
        time_s=float(t[last + 1]) if last + 1 < len(t) else math.nan,
        overshoot_m=float(max(0.0, np.max(-side * seen.lateral_error))),
        mean_25_s_m=_mean(t, seen.distance, t <= WINDOW_S),
        mean_approach_m=_mean(t, seen.distance, t <= APPROACH_S),
        mean_after_m=_mean(t, seen.distance, t > APPROACH_S),
    )


@dataclass(frozen=True)
class Turn:
    """A turn in place.

    Attributes:
        turned_rad: in all, positive to the left.
        error_rad: beyond what was asked for.
        displacement_m: how far the vehicle got away from its place.
    """

    turned_rad: float
    error_rad: float
    displacement_m: float

    @property
    def completed(self) -> bool:
        """Whether it turned as far as asked, and stayed where it was."""
        return abs(self.error_rad) <= TURNED_RAD and self.displacement_m <= STAYED_M

    def summary(self) -> dict[str, Any]:
        """The entry `turn` of summary.json."""
        return {"turned_rad": self.turned_rad, "error_rad": self.error_rad, "displacement_m": self.displacement_m}


def turn_in_place(xy: Array, yaw: Array, asked_rad: float) -> Turn:
    """Judge a turn in place.

    Args:
        xy: true position, n x 2, m.
        yaw: true yaw, rad.
        asked_rad: how far to turn, positive to the left.
    """
    angle = np.unwrap(yaw)
    turned = float(angle[-1] - angle[0])
    away = np.hypot(xy[:, 0] - xy[0, 0], xy[:, 1] - xy[0, 1])
    return Turn(turned, turned - asked_rad, float(away.max()))


def _mean(t: Array, values: Array, chosen: npt.NDArray[np.bool_]) -> float:
    return time_average(t[chosen], values[chosen]) if chosen.any() else math.nan
