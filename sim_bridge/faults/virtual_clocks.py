# SPDX-License-Identifier: Apache-2.0
"""The clocks of a computer in virtual time, which can be set, and which part while it is suspended."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.executors.clocks import ClockReading
from runtime.link.clocks import Instant

UTC_NS = 1_700_000_000_000_000_000
"""Unix time at the start."""


@dataclass
class VirtualClocks:
    """The present.

    Attributes:
        monotonic_ns: what the loops count by; it stands still while the computer is suspended.
        suspended_ns: for how long that was so far: the world is ahead by so much.
        set_ns: unix time, less the time since the start.
    """

    monotonic_ns: int = 0
    suspended_ns: int = 0
    set_ns: int = UTC_NS

    @property
    def world_ns(self) -> int:
        """Time of the world, which is never suspended."""
        return self.monotonic_ns + self.suspended_ns

    def unix_ns(self, world_ns: int) -> int:
        """A time of the world by the unix clock as it is now."""
        return world_ns + self.set_ns

    def read(self) -> ClockReading:
        """All clocks."""
        return ClockReading(self.monotonic_ns, self.unix_ns(self.world_ns), self.world_ns)

    def instant(self) -> Instant:
        """Those by which messages are judged."""
        return Instant(self.monotonic_ns, self.unix_ns(self.world_ns))
