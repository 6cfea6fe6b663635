# SPDX-License-Identifier: Apache-2.0
"""The last gate before the buses: frames whose commands have become too old on their way are not sent."""

from __future__ import annotations

from typing import Protocol

from runtime.signals import CanFrames

NEVER_OLD_NS = (1 << 63) - 1
"""Stamp of frames that are true at any time."""


class FrameOutput(Protocol):
    """Where frames leave a loop."""

    def write(self, record: CanFrames, now_ns: int) -> None:
        """Send them."""


class FreshFrames:
    """An output port that passes frames on while they are fresh; drives that get none damp by their own time-out.

    Args:
        port: sends what passes.
        age_max_ns: of the tick that made the commands.

    Attributes:
        stale: batches that were not sent, since start.
    """

    def __init__(self, port: FrameOutput, age_max_ns: int) -> None:
        self._port, self._age_max_ns = port, age_max_ns
        self.stale = 0

    def write(self, record: CanFrames, now_ns: int) -> None:
        """Send the frames if they are not too old."""
        if now_ns - record.stamp_ns > self._age_max_ns:
            self.stale += 1
        else:
            self._port.write(record, now_ns)
