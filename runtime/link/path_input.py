# SPDX-License-Identifier: Apache-2.0
"""Paths from zenoh to the tracker."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from runtime.link.checks import check_finite, check_frame
from runtime.link.clocks import Instant, StampWindow
from runtime.link.per_source import PerSource
from runtime.messages.errors import MessageError
from runtime.messages.path import Waypoints
from runtime.robots.link_config import LinkConfig
from runtime.signals import Path
from runtime.tracking.sections import split_at_cusps

_CLOSED_WITHIN_M = 1e-3
_FEWEST = 2


@dataclass
class _Sender:
    """What is kept of a sender.

    Attributes:
        window: of the stamps of its paths.
        speed: along its next paths, m/s.
    """

    window: StampWindow
    speed: float


class PathUse:
    """Fills and hands on `Path` records.

    A path whose last point is its first, and that turns back nowhere, there neither, is closed, and the last point is
    dropped. A speed holds for the paths of the same sender that come after it; a sender that was forgotten, being one
    of many, has the configured speed again.

    Args:
        config: frames, age and speeds.
        record: to fill.
        write: hands it on.
    """

    def __init__(self, config: LinkConfig, record: Path, write: Callable[[Path], None]) -> None:
        self._frames, self._record, self._write = config.path_frames, record, write
        self._fastest = config.path_speed_max_mps
        self._senders = PerSource(
            lambda: _Sender(StampWindow(config.path_age_max_ns, config.future_max_ns), config.path_speed_mps)
        )

    def set_speed(self, speed: float, source: int, now: Instant) -> None:
        """Use a speed along paths."""
        check_finite(speed)
        if not 0.0 < speed <= self._fastest:
            raise MessageError("the speed is out of bounds")
        self._senders.of(source).speed = speed

    def __call__(self, path: Waypoints, source: int, now: Instant) -> None:
        """Use a path."""
        check_frame(path.frame, self._frames)
        points = path.points
        for point in points:
            check_finite(*point)
        if not points:
            self._withdraw(path, source, now)
            return
        closed = _leads_back(points)
        if closed:
            points = points[:-1]
        if len(points) < _FEWEST:
            raise MessageError("the path has fewer than two points")
        if len(points) > len(self._record.x):
            raise MessageError("the path has too many poses")
        record, sender, count = self._record, self._senders.of(source), len(points)
        record.stamp_ns, record.source = sender.window.monotonic_ns(path.stamp_ns, now), source
        record.count, record.closed, record.speed = count, closed, sender.speed
        for row, values in ((record.x, [x for x, _ in points]), (record.y, [y for _, y in points])):
            row[:count], row[count:] = values, 0.0
        self._write(record)

    def _withdraw(self, path: Waypoints, source: int, now: Instant) -> None:
        """A path without poses takes back the one before."""
        stamp_ns = self._senders.of(source).window.monotonic_ns(path.stamp_ns, now)
        self._record.clear()
        self._record.stamp_ns, self._record.source = stamp_ns, source
        self._write(self._record)


def _leads_back(points: Sequence[tuple[float, float]]) -> bool:
    """Whether a path leads on from its last point, which is its first, to its second."""
    meets = len(points) > _FEWEST and math.dist(points[0], points[-1]) < _CLOSED_WITHIN_M
    return meets and len(split_at_cusps([*points, points[1]])) == 1
