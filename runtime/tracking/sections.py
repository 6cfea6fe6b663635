# SPDX-License-Identifier: Apache-2.0
"""A path with cusps, in sections that are driven forwards and backwards in turn."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate, pairwise

import numpy as np
import numpy.typing as npt

from runtime.models.rotations import wrapped
from runtime.tracking.errors import PathError
from runtime.tracking.polyline import Polyline
from runtime.tracking.waypoints import MAXIMUM_TURN_RAD, MINIMUM_SPACING_M

Array = npt.NDArray[np.float64]


def split_at_cusps(points: npt.ArrayLike) -> list[Array]:
    """The stretches of waypoints between the points where an open path turns back; each begins where one ended.

    What is no list of at least two finite points far enough apart is returned whole, for `Polyline` to refuse.
    """
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2 or not np.isfinite(array).all():
        return [array]
    steps = np.diff(array, axis=0)
    if (np.hypot(steps[:, 0], steps[:, 1]) < MINIMUM_SPACING_M).any():
        return [array]
    headings = np.arctan2(steps[:, 1], steps[:, 0]).tolist()
    turns = [abs(math.remainder(after - before, math.tau)) for before, after in pairwise(headings)]
    cusps = [index + 1 for index, turn in enumerate(turns) if turn > MAXIMUM_TURN_RAD]
    bounds = [0, *cusps, len(array) - 1]
    return [array[begin : end + 1] for begin, end in pairwise(bounds)]


def sections_of(points: npt.ArrayLike, closed: bool = False) -> list[Polyline]:
    """The sections of a path; a closed path has one.

    Raises:
        PathError: if one cannot be followed; a closed path must have no cusps.
    """
    if closed:
        return [Polyline(points, closed=True)]
    stretches = split_at_cusps(points)
    sections = []
    for number, stretch in enumerate(stretches, start=1):
        try:
            sections.append(Polyline(stretch))
        except PathError as error:
            place = f"section {number} of {len(stretches)}, " if len(stretches) > 1 else ""
            raise PathError(f"{place}{error}") from error
    return sections


class SectionedPath:
    """A path that may turn back at cusps, with one arc length over all of its sections.

    Args:
        points: waypoints, n x 2, m.
        closed: the last waypoint leads on to the first.

    Attributes:
        sections: in the order in which they are driven.
        begins: arc length where each of them begins, m.
        length: of all of them, m.

    Raises:
        PathError: see `sections_of`.
    """

    def __init__(self, points: npt.ArrayLike, closed: bool = False) -> None:
        self.sections = tuple(sections_of(points, closed))
        *self.begins, self.length = accumulate((section.length for section in self.sections), initial=0.0)

    @property
    def goal(self) -> tuple[float, float]:
        """Where the path ends, m."""
        return self.sections[-1].goal

    def point(self, s: float) -> tuple[float, float]:
        """The point at arc length `s`, m; extrapolated beyond both ends."""
        number = max(bisect_right(self.begins, s) - 1, 0)
        return self.sections[number].point(s - self.begins[number])


def begins_backwards(section: Polyline, yaw: float) -> bool:
    """Whether a vehicle at this heading points away from where the section goes."""
    return abs(wrapped(section.heading(0.0) - yaw)) > 0.5 * math.pi
