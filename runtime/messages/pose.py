# SPDX-License-Identifier: Apache-2.0
"""geometry_msgs/PoseStamped and PoseWithCovarianceStamped: where a localisation says the robot is."""

from __future__ import annotations

from typing import NamedTuple

from runtime.messages.cdr import CdrTemplate
from runtime.messages.cdr_reader import CdrReader
from runtime.signals import Pose

_COVARIANCE = 36


class StampedPose(NamedTuple):
    """A pose at a time.

    Attributes:
        stamp_ns: of the header.
        frame: in which the pose is given.
        position: x, y, z, m.
        orientation: x, y, z, w.
    """

    stamp_ns: int
    frame: str
    position: tuple[float, ...]
    orientation: tuple[float, ...]


class PoseStampedMessage:
    """Encodes geometry_msgs/PoseStamped."""

    def __init__(self, frame: str = "odom") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        slot = template.float64(7)
        self._values = template.view(slot, 7)

    def encode(self, pose: Pose) -> bytes:
        """The message of one pose."""
        self._template.set_stamp(self._stamp, pose.stamp_ns)
        self._values[:3], self._values[3:] = pose.position, pose.orientation
        return self._template.to_bytes()


def _pose(reader: CdrReader, after: int) -> StampedPose:
    stamp_ns, frame = reader.header()
    values = reader.numbers("d", 7 + after)
    reader.finish()
    return StampedPose(stamp_ns, frame, values[:3], values[3:7])


def decode_pose_stamped(payload: bytes) -> StampedPose:
    """The pose in a geometry_msgs/PoseStamped; MessageError if it is none."""
    return _pose(CdrReader(payload), 0)


def decode_pose_with_covariance_stamped(payload: bytes) -> StampedPose:
    """The pose in a geometry_msgs/PoseWithCovarianceStamped; MessageError if it is none."""
    return _pose(CdrReader(payload), _COVARIANCE)
