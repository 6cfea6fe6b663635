# SPDX-License-Identifier: Apache-2.0
"""When a vehicle turned from one section of a path with cusps to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from runtime.tracking.polyline import Polyline

Array = npt.NDArray[np.float64]


def section_starts(
    x: Array, y: Array, sections: Sequence[Polyline], window_m: float, near_m: float, back_m: float
) -> list[int]:
    """Index of the sample from which on each section is driven, of those that were come to.

    Where a section ends the vehicle goes back: the next one is driven from the sample at which it was furthest along.

    Args:
        x: true position, m.
        y: true position, m.
        sections: of the path, in order.
        window_m: how far ahead of the last nearest point the next is searched.
        near_m: a section has been driven when no more than this is left of it.
        back_m: by how much the vehicle has to have gone back.
    """
    starts = [0]
    for section in sections[:-1]:
        turn = _turn(x, y, starts[-1], section, window_m, near_m, back_m)
        if turn is None:
            break
        starts.append(turn)
    return starts


def _turn(
    x: Array, y: Array, begin: int, section: Polyline, window_m: float, near_m: float, back_m: float
) -> int | None:
    """Where the vehicle was furthest along a section before it went back, or None if it did not."""
    (end_x, end_y), heading = section.goal, section.heading(section.length)
    s, furthest, turn = 0.0, -math.inf, begin
    for k in range(begin, len(x)):
        s = section.closest(float(x[k]), float(y[k]), s, window_m).progress
        if s < section.length - near_m:
            continue
        along = math.cos(heading) * (float(x[k]) - end_x) + math.sin(heading) * (float(y[k]) - end_y)
        if along > furthest:
            furthest, turn = along, k
        elif along < furthest - back_m:
            return turn
    return None
