# SPDX-License-Identifier: Apache-2.0
"""The last gate before the buses: frames whose commands have become too old on their way are not sent."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from runtime.signals import CanFrames

NEVER_OLD_NS = (1 << 63) - 1
"""Stamp of frames that are true at any time."""


class FrameOutput(Protocol):
    """Where frames leave a loop."""

    def write(self, record: CanFrames, now_ns: int) -> None:
        """Send them."""


@runtime_checkable
class CountingOutput(Protocol):
    """An output that counts, at their buses, the frames that it is not given; `BusMonitor` then reports them."""

    def withhold(self, record: CanFrames) -> None:
        """Count them."""


class FreshFrames:
    """An output port that passes frames on while they are fresh; drives that get none damp by their own time-out.

    Args:
        port: sends what passes; the rest is counted if it is a `CountingOutput`.
        age_max_ns: of the tick that made the commands.
    """

    def __init__(self, port: FrameOutput, age_max_ns: int) -> None:
        self._port, self._age_max_ns = port, age_max_ns
        self._counting = port if isinstance(port, CountingOutput) else None

    def write(self, record: CanFrames, now_ns: int) -> None:
        """Send the frames if they are not too old."""
        if now_ns - record.stamp_ns <= self._age_max_ns:
            self._port.write(record, now_ns)
        elif self._counting is not None:
            self._counting.withhold(record)
