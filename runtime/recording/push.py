# SPDX-License-Identifier: Apache-2.0
"""How a push was withstood: pure functions on arrays of the true pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.recording.metrics import AnyPath, or_none, project

RETURN_S, RETURN_M = 5.0, 0.15
SPEED_S, SPEED_SHARE = 3.0, 0.1
SPEED_WINDOW_S = 0.8
"""Two gait cycles: the speed of a trotting trunk swings within one."""


@dataclass(frozen=True)
class PushRecovery:
    """What a push did to a walk.

    Attributes:
        passed: no fall, and within 0.15 m of the path 5 s later.
        back_at_speed: along the path, the speed 3 s later is within 10 % of the commanded one.
        displacement_m: largest distance to the path from the push on, until 5 s later.
        distance_later_m: distance to the path 5 s later; NaN if the samples end before.
        speed_later_mps: along the path, averaged over the two gait cycles that follow 3 s later; NaN likewise.
    """

    passed: bool
    back_at_speed: bool
    displacement_m: float
    distance_later_m: float
    speed_later_mps: float

    def summary(self) -> dict[str, Any]:
        """The entry `push` of summary.json."""
        return {
            "passed": self.passed,
            "back_at_speed": self.back_at_speed,
            "displacement_m": or_none(self.displacement_m),
            "distance_later_m": or_none(self.distance_later_m),
            "speed_later_mps": or_none(self.speed_later_mps),
        }


def push_recovery(
    t: npt.ArrayLike,
    xy: npt.ArrayLike,
    path: AnyPath,
    push_end_s: float | None,
    commanded_mps: float,
    fell: bool,
) -> PushRecovery:
    """Judge how a push was withstood.

    Args:
        t: sample times, rising, s.
        xy: true trunk origin, n x 2, m.
        path: the path.
        push_end_s: when the force ended, on the clock of the samples; None if it never came, which passes nothing.
        commanded_mps: speed along the path.
        fell: whether the robot fell.
    """
    t, xy = np.asarray(t, dtype=np.float64), np.asarray(xy, dtype=np.float64)
    if push_end_s is None or len(t) == 0:
        return PushRecovery(False, False, math.nan, math.nan, math.nan)
    seen = project(xy[:, 0], xy[:, 1], np.zeros(len(t)), path)
    later = push_end_s + RETURN_S
    after = (t >= push_end_s) & (t <= later)
    displacement = float(seen.distance[after].max()) if after.any() else math.nan
    distance = float(np.interp(later, t, seen.distance)) if t[-1] >= later else math.nan
    begin, end = push_end_s + SPEED_S, push_end_s + SPEED_S + SPEED_WINDOW_S
    speed = math.nan
    if t[-1] >= end:
        gone = np.interp([begin, end], t, seen.progress)
        speed = float(gone[1] - gone[0]) / SPEED_WINDOW_S
    return PushRecovery(
        passed=not fell and distance <= RETURN_M,
        back_at_speed=not fell and abs(speed - commanded_mps) <= SPEED_SHARE * commanded_mps,
        displacement_m=displacement,
        distance_later_m=distance,
        speed_later_mps=speed,
    )
