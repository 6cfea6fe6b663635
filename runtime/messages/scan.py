# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/LaserScan and PointCloud2: what a range finder sees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.messages.cdr_reader import CdrReader
from runtime.messages.errors import MessageError

_FLOAT32 = 7
_MOST_FIELDS = 64
_LARGEST_POINT = 1024


class Scan(NamedTuple):
    """Ranges in a plane.

    Attributes:
        stamp_ns: of the header, at the first range.
        frame: of the sensor.
        first_angle, angle_step: rad, about the sensor's z.
        shortest, longest: m; ranges beyond them are to be left out.
        ranges: m, as many as the message has.
    """

    stamp_ns: int
    frame: str
    first_angle: float
    angle_step: float
    shortest: float
    longest: float
    ranges: npt.NDArray[np.float32]


class Cloud(NamedTuple):
    """Points in space.

    Attributes:
        stamp_ns: of the header.
        frame: of the sensor.
        points: (n, 3), m; not a number where the sensor saw nothing.
    """

    stamp_ns: int
    frame: str
    points: npt.NDArray[np.float32]


def decode_laser_scan(payload: bytes) -> Scan:
    """A sensor_msgs/LaserScan; MessageError if it is none."""
    reader = CdrReader(payload)
    stamp_ns, frame = reader.header()
    first, _, step, _, _, shortest, longest = reader.numbers("f", 7)
    ranges = reader.array("f", reader.count())
    reader.array("f", reader.count())
    reader.finish()
    return Scan(stamp_ns, frame, first, step, shortest, longest, ranges)


def decode_point_cloud(payload: bytes) -> Cloud:
    """A sensor_msgs/PointCloud2 with x, y, z as floats; MessageError if it is none."""
    reader = CdrReader(payload)
    stamp_ns, frame = reader.header()
    height, width = reader.numbers("I", 2)
    offsets = _offsets(reader)
    big_endian = reader.boolean()
    point_step, row_step = reader.numbers("I", 2)
    data = reader.array("B", reader.count())
    reader.boolean()
    reader.finish()
    if row_step < width * point_step or height * row_step != len(data):
        raise MessageError("the cloud's sizes do not agree")
    if not max(offsets) + np.dtype("f4").itemsize <= point_step <= _LARGEST_POINT:
        raise MessageError("the cloud's points are smaller than their parts, or too large")
    parts = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": [">f4" if big_endian else "<f4"] * 3,
            "offsets": offsets,
            "itemsize": point_step,
        }
    )
    rows = data.reshape(height, row_step)[:, : width * point_step]
    cloud = np.ascontiguousarray(rows).view(parts).reshape(-1)
    return Cloud(stamp_ns, frame, np.stack([cloud[name].astype("=f4") for name in ("x", "y", "z")], axis=1))


def _offsets(reader: CdrReader) -> list[int]:
    """Where x, y and z stand in a point."""
    count = reader.count()
    if count > _MOST_FIELDS:
        raise MessageError("the cloud has too many parts")
    found = {}
    for _ in range(count):
        name = reader.string()
        (offset,), (kind,), (number,) = reader.numbers("I"), reader.numbers("B"), reader.numbers("I")
        if name in ("x", "y", "z") and kind == _FLOAT32 and number == 1:
            found[name] = int(offset)
    if len(found) != 3:
        raise MessageError("the cloud's points have no x, y and z")
    return [found[name] for name in ("x", "y", "z")]
