# SPDX-License-Identifier: Apache-2.0
"""geometry_msgs/Twist and TwistStamped: velocities asked of the body."""

from __future__ import annotations

from typing import NamedTuple

from runtime.messages.cdr import CdrTemplate
from runtime.messages.cdr_reader import CdrReader
from runtime.signals import BodyCommand
from runtime.vehicle_signals import TwistCommand


class Velocity(NamedTuple):
    """What is used of a twist.

    Attributes:
        stamp_ns: of the header; 0 if the message has none.
        frame: of the header; empty if the message has none.
        forward, lateral: m/s.
        yaw_rate: rad/s.
    """

    stamp_ns: int
    frame: str
    forward: float
    lateral: float
    yaw_rate: float


def _velocity(reader: CdrReader, stamp_ns: int, frame: str) -> Velocity:
    forward, lateral, _, _, _, yaw_rate = reader.numbers("d", 6)
    reader.finish()
    return Velocity(stamp_ns, frame, forward, lateral, yaw_rate)


def decode_twist(payload: bytes) -> Velocity:
    """A geometry_msgs/Twist; MessageError if it is none."""
    return _velocity(CdrReader(payload), 0, "")


def decode_twist_stamped(payload: bytes) -> Velocity:
    """A geometry_msgs/TwistStamped; MessageError if it is none."""
    reader = CdrReader(payload)
    return _velocity(reader, *reader.header())


def encode_twist(forward: float, lateral: float, yaw_rate: float) -> bytes:
    """A geometry_msgs/Twist, m/s and rad/s."""
    template = CdrTemplate()
    slot = template.float64(6)
    template.view(slot, 6)[:] = forward, lateral, 0.0, 0.0, 0.0, yaw_rate
    return template.to_bytes()


class TwistStampedMessage:
    """Encodes /cmd_vel."""

    def __init__(self, frame: str = "base_link") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        self._twist = template.view(template.float64(6), 6)

    def encode(self, command: BodyCommand | TwistCommand) -> bytes:
        """The message of one command."""
        self._template.set_stamp(self._stamp, command.stamp_ns)
        self._twist[:2] = command.velocity
        self._twist[5] = command.yaw_rate
        return self._template.to_bytes()
