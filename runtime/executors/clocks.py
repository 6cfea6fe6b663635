# SPDX-License-Identifier: Apache-2.0
"""How the system clock stands to the monotonic one that every loop runs by: steps and suspensions are to be seen."""

from __future__ import annotations

import time
from dataclasses import dataclass

LOOK_EVERY_NS = 1_000_000_000
"""All who watch the clocks look once a second, so that they see the same."""
STEP_NS = 10_000_000
"""A clock that the kernel steers changes less than this from one look to the next: 0.5 ms."""


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
    """The clocks now; a reading that was preempted is taken again."""
    while True:
        reading = ClockReading(time.monotonic_ns(), time.time_ns(), time.clock_gettime_ns(time.CLOCK_BOOTTIME))
        if time.monotonic_ns() - reading.monotonic_ns < STEP_NS // 2:
            return reading


class ClockWatch:
    """Compares each look with the one before.

    Args:
        first: the first look.

    Attributes:
        steps: of the system clock, since then.
        suspends: of the machine, since then.
    """

    def __init__(self, first: ClockReading) -> None:
        self._last = first
        self.steps = self.suspends = 0

    def look(self, now: ClockReading) -> str:
        """What happened to the clocks since the last look, as a phrase; empty if nothing did."""
        last, self._last = self._last, now
        ran_ns = now.monotonic_ns - last.monotonic_ns
        suspended_ns = now.boot_ns - last.boot_ns - ran_ns
        stepped_ns = now.utc_ns - last.utc_ns - ran_ns - suspended_ns
        if suspended_ns > STEP_NS:
            self.suspends += 1
            return f"the system was suspended for {suspended_ns / 1e9:.3f} s"
        if abs(stepped_ns) > STEP_NS:
            self.steps += 1
            return f"the system clock was set {stepped_ns / 1e9:+.3f} s"
        return ""
