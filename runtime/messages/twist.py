# SPDX-License-Identifier: Apache-2.0
"""geometry_msgs/TwistStamped from what the tracker asks of the body."""

from __future__ import annotations

from runtime.messages.cdr import CdrTemplate
from runtime.signals import BodyCommand


class TwistStampedMessage:
    """Encodes /cmd_vel."""

    def __init__(self, frame: str = "base_link") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        self._twist = template.view(template.float64(6), 6)

    def encode(self, command: BodyCommand) -> bytes:
        """The message of one command."""
        self._template.set_stamp(self._stamp, command.stamp_ns)
        self._twist[:2] = command.velocity
        self._twist[5] = command.yaw_rate
        return self._template.to_bytes()
