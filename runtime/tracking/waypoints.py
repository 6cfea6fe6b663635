# SPDX-License-Identifier: Apache-2.0
"""Which lists of waypoints are a path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.models.rotations import wrapped
from runtime.tracking.errors import PathError

MINIMUM_SPACING_M = 1e-3
MAXIMUM_COORDINATE_M = 1e6
MAXIMUM_TURN_RAD = math.radians(150.0)


def check_waypoints(
    points: npt.ArrayLike,
    *,
    closed: bool = False,
    capacity: int | None = None,
    source: str = "path",
    rows: Sequence[int] | None = None,
) -> npt.NDArray[np.float64]:
    """Check that waypoints make a path that can be followed.

    Args:
        points: waypoints, n x 2, in metres.
        closed: the last waypoint leads on to the first.
        capacity: largest number of waypoints, if bounded.
        source: what to call the path in messages (a file, a topic).
        rows: row of each waypoint in its file; without it, messages count points from 1.

    Returns:
        The waypoints as an n x 2 array.

    Raises:
        PathError: too few or too many points, one that is not finite or beyond 1000 km, one within 1 mm of the one
            before, or a cusp (a turn of more than 150 degrees).
    """
    place = _Place(source, rows)
    array = _checked(points, closed, capacity, place)
    _check_turns(array, closed, place)
    return array


def check_cusped_waypoints(
    points: npt.ArrayLike,
    *,
    closed: bool = False,
    capacity: int | None = None,
    source: str = "path",
    rows: Sequence[int] | None = None,
) -> npt.NDArray[np.float64]:
    """Check that waypoints make a path for a vehicle that goes on backwards where an open path turns back.

    As `check_waypoints`, but for the cusps of an open path.
    """
    place = _Place(source, rows)
    array = _checked(points, closed, capacity, place)
    if closed:
        _check_turns(array, closed, place)
    return array


class _Place(NamedTuple):
    """Where waypoints come from, for messages."""

    source: str
    rows: Sequence[int] | None

    def of(self, index: int) -> str:
        """The place of one waypoint."""
        return f"{self.source}: point {index + 1}" if self.rows is None else f"{self.source}: row {self.rows[index]}"


def _checked(points: npt.ArrayLike, closed: bool, capacity: int | None, place: _Place) -> npt.NDArray[np.float64]:
    """The waypoints, if they are enough, finite, and apart."""
    source, array = place.source, np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        if array.size == 0:
            raise PathError(f"{source}: the path has no points, at least 2 are needed")
        raise PathError(f"{source}: waypoints have the shape {array.shape}, n x 2 is needed")
    count = len(array)
    if count < 2:
        raise PathError(f"{source}: the path has {count} point{'' if count == 1 else 's'}, at least 2 are needed")
    if capacity is not None and count > capacity:
        raise PathError(f"{source}: the path has {count} points, at most {capacity} fit")
    for index, (x, y) in enumerate(array.tolist()):
        for name, value in (("x", x), ("y", y)):
            if not math.isfinite(value):
                raise PathError(f"{place.of(index)}: {name} is {value}, which is not a finite number")
            if abs(value) > MAXIMUM_COORDINATE_M:
                raise PathError(f"{place.of(index)}: {name} = {value:g} m is beyond {MAXIMUM_COORDINATE_M:g} m")
    dx, dy = _steps(array, closed)
    for index, spacing in enumerate(np.hypot(dx, dy).tolist()):
        if spacing < MINIMUM_SPACING_M:
            after = (index + 1) % count
            other = "the point before" if after else "the last point of a closed path"
            raise PathError(f"{place.of(after)}: ({array[after, 0]:g}, {array[after, 1]:g}) repeats {other}")
    return array


def _check_turns(array: npt.NDArray[np.float64], closed: bool, place: _Place) -> None:
    """Refuse a path that turns back."""
    dx, dy = _steps(array, closed)
    headings = np.arctan2(dy, dx).tolist()
    corners = [(index + 1, headings[index], headings[index + 1]) for index in range(len(headings) - 1)]
    if closed:
        corners.append((0, headings[-1], headings[0]))
    for index, before, after_heading in corners:
        turn = abs(wrapped(after_heading - before))
        if turn > MAXIMUM_TURN_RAD:
            raise PathError(
                f"{place.of(index)}: the path turns back by {math.degrees(turn):.0f} degrees, "
                f"at most {math.degrees(MAXIMUM_TURN_RAD):.0f} can be followed"
            )


def _steps(array: npt.NDArray[np.float64], closed: bool) -> npt.NDArray[np.float64]:
    """From each waypoint to the next, 2 x n."""
    ring = np.vstack((array, array[:1])) if closed else array
    return np.diff(ring, axis=0).T
