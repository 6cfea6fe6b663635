# SPDX-License-Identifier: Apache-2.0
"""nav_msgs/Path: waypoints to follow."""

from __future__ import annotations

import math
from typing import NamedTuple

from runtime.messages.cdr import CdrTemplate
from runtime.messages.cdr_reader import CdrReader
from runtime.messages.errors import MessageError
from runtime.signals import Path


class Waypoints(NamedTuple):
    """What is used of a path.

    Attributes:
        stamp_ns: of the header.
        frame: in which the waypoints are given; that of the poses does not count.
        points: (x, y), m.
    """

    stamp_ns: int
    frame: str
    points: list[tuple[float, float]]


def decode_path(payload: bytes, capacity: int) -> Waypoints:
    """A nav_msgs/Path of up to `capacity` poses; MessageError if it is none, or longer."""
    reader = CdrReader(payload)
    stamp_ns, frame = reader.header()
    count = reader.count()
    if count > capacity:
        raise MessageError("the path has too many poses")
    points = []
    for _ in range(count):
        reader.header()
        x, y, *_ = reader.numbers("d", 7)
        points.append((x, y))
    reader.finish()
    return Waypoints(stamp_ns, frame, points)


class PathMessage:
    """Encodes /path; each pose looks along the path. Paths are rare, so the message is laid out anew each time."""

    def __init__(self, frame: str = "odom") -> None:
        self._frame = frame

    def encode(self, path: Path) -> bytes:
        """The message of one path; a count beyond the capacity is cut to it."""
        count = min(path.count, len(path.x))
        x, y = path.x[:count].tolist(), path.y[:count].tolist()
        template = CdrTemplate()
        stamps = [template.header(self._frame)]
        template.count(count)
        slots = []
        for _ in range(count):
            stamps.append(template.header(self._frame))
            slots.append(template.float64(7))
        for slot in stamps:
            template.set_stamp(slot, path.stamp_ns)
        for i, slot in enumerate(slots):
            after = (i + 1) % count if path.closed else min(i + 1, count - 1)
            before = i if after != i else max(i - 1, 0)
            half = 0.5 * math.atan2(y[after] - y[before], x[after] - x[before])
            template.view(slot, 7)[:] = (x[i], y[i], 0.0, 0.0, 0.0, math.sin(half), math.cos(half))
        return template.to_bytes()
