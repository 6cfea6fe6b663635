# SPDX-License-Identifier: Apache-2.0
"""How the system clock stands to the monotonic one that every loop runs by: steps and suspensions are to be seen."""

from __future__ import annotations

import time
from dataclasses import dataclass

STEP_NS = 50_000_000
"""A clock that is adjusted to a time server drifts less than this within a second."""


@dataclass(frozen=True)
class ClockReading:
    """One look at the clocks.

    Attributes:
        monotonic_ns: the present.
        utc_ns: system time.
        boot_ns: time since the system was started, which goes on while it is suspended.
    """

    monotonic_ns: int
    utc_ns: int
    boot_ns: int


def read_clocks() -> ClockReading:
    """The clocks now."""
    return ClockReading(time.monotonic_ns(), time.time_ns(), time.clock_gettime_ns(time.CLOCK_BOOTTIME))


class ClockWatch:
    """Compares each look with the one before.

    Args:
        first: the first look.
    """

    def __init__(self, first: ClockReading) -> None:
        self._last = first

    def look(self, now: ClockReading) -> str:
        """What happened to the clocks since the last look, as a phrase; empty if nothing did."""
        last, self._last = self._last, now
        ran_ns = now.monotonic_ns - last.monotonic_ns
        suspended_ns = now.boot_ns - last.boot_ns - ran_ns
        stepped_ns = now.utc_ns - last.utc_ns - ran_ns - suspended_ns
        if suspended_ns > STEP_NS:
            return f"the system was suspended for {suspended_ns / 1e9:.3f} s"
        if abs(stepped_ns) > STEP_NS:
            return f"the system clock was set {stepped_ns / 1e9:+.3f} s"
        return ""
