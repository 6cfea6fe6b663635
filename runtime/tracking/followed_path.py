# SPDX-License-Identifier: Apache-2.0
"""The path that a tracker follows, taken from the path signal and held in the tracker's own memory."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from runtime.records import Record, boolean, float64, float64_array, uint32
from runtime.signals import OperatorRequest, Path
from runtime.tracking.errors import PathError
from runtime.tracking.inputs import waypoints_of

Points = npt.NDArray[np.float64]
Line = TypeVar("Line")


class FollowedPathMemory(Record):
    """The path that is followed, and what was made of the last path message."""

    seen_path = uint32("", "checksum of the last path message, good or bad")
    rejected_paths = uint32()
    foreign_paths = uint32("", "those of them that were not of the lease's holder")
    count = uint32("", "waypoints of the path that is followed, 0 none")
    closed = boolean()
    path_speed = float64("m/s", "commanded")
    x = float64_array("path", "m")
    y = float64_array("path", "m")


class FollowedPath(Generic[Line]):
    """Takes up paths; one whose contents cannot be followed is counted, and the one before is kept.

    A path without waypoints withdraws the one that is followed. The same waypoints sent again only change the speed.
    A path of long ago, which a control that is started again finds, is counted and not followed: who moves the robot
    now may not know of it. While somebody holds the lease, paths and withdrawals of others are counted and refused
    for good: who takes the lease later sends its path anew. While nobody holds it, anyone may send one.

    Args:
        memory: where the path is held.
        make: makes what is followed of waypoints, n x 2, and whether they are closed; a `PathError` refuses them.
        age_max_ns: of a path when it is taken up.

    Attributes:
        line: what is followed, None if there is none.
    """

    def __init__(self, memory: FollowedPathMemory, make: Callable[[Points, bool], Line], age_max_ns: int) -> None:
        self._memory, self._make, self._age_max_ns = memory, make, age_max_ns
        self.line: Line | None = None
        self._held = self._contents()

    def take(self, path: Path, request: OperatorRequest, now_ns: int) -> bool:
        """Take up the path signal where its bytes changed; true if another path is followed now, or none any more.

        Args:
            path: the signal.
            request: tells who holds the lease.
            now_ns: the present.
        """
        memory, checksum = self._memory, zlib.crc32(path.to_bytes())
        if checksum == memory.seen_path:
            return False
        memory.seen_path = checksum
        if is_foreign(path, request):
            memory.rejected_paths += 1
            memory.foreign_paths += 1
            return False
        if path.stamp_ns and now_ns - path.stamp_ns > self._age_max_ns:
            memory.rejected_paths += 1
            return False
        if path.count == 0:
            memory.count, self.line = 0, None
            return True
        try:
            line = self._make(waypoints_of(path), bool(path.closed))
        except PathError:
            memory.rejected_paths += 1
            return False
        memory.path_speed = path.speed
        if self._follows(path):
            return False
        memory.count, memory.closed = path.count, path.closed
        memory.x, memory.y = path.x, path.y
        self.line, self._held = line, self._contents()
        return True

    def recall(self) -> None:
        """Make the path anew after the memory was restored, if it is another one."""
        memory, contents = self._memory, self._contents()
        if self.line is not None and contents == self._held:
            return
        count, self._held = memory.count, contents
        points = np.column_stack((memory.x[:count], memory.y[:count]))
        self.line = self._make(points, bool(memory.closed)) if count else None

    def _follows(self, path: Path) -> bool:
        """Whether these waypoints are followed already."""
        memory, count = self._memory, path.count
        if memory.count != count or memory.closed != path.closed:
            return False
        return np.array_equal(memory.x[:count], path.x[:count]) and np.array_equal(memory.y[:count], path.y[:count])

    def _contents(self) -> tuple[int, bool, bytes, bytes]:
        """All that the polyline is a function of."""
        memory, count = self._memory, self._memory.count
        return count, bool(memory.closed), memory.x[:count].tobytes(), memory.y[:count].tobytes()


def is_foreign(path: Path, request: OperatorRequest) -> bool:
    """Whether a path is of another than the lease's holder; one that was never sent is nobody's."""
    return bool(path.stamp_ns and request.held and path.source != request.holder)
