# SPDX-License-Identifier: Apache-2.0
"""Whether the ticks of a loop follow each other without one missing.

A loop that overran skips whole periods, and its next tick says how many: those were never stepped, so nothing is
missing. An index that jumps by more is a gap: ticks were stepped and are not in the log.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Gap:
    """Ticks that are missing, or a loop that began anew.

    Attributes:
        loop: name of the loop.
        after: index of the last tick before it; -1 at the beginning of a log.
        before: index of the first tick after it.
        missing: ticks that may be missing; periods that were skipped meanwhile count too.
        begin_ns, end_ns: releases of these two ticks; the same one twice at the beginning of a log.
    """

    loop: str
    after: int
    before: int
    missing: int
    begin_ns: int
    end_ns: int

    @property
    def is_restart(self) -> bool:
        """Whether the loop counts anew."""
        return self.before <= self.after

    def __str__(self) -> str:
        at = f"{self.end_ns / 1e9:.3f} s"
        if self.is_restart:
            return f"{self.loop} began anew with tick {self.before} at {at}, after its tick {self.after}"
        if self.after < 0:
            return f"{self.loop} is recorded from its tick {self.before} on ({at}); what was before is not in this log"
        return (
            f"{self.loop}: up to {self.missing} ticks are missing between tick {self.after} "
            f"({self.begin_ns / 1e9:.3f} s) and tick {self.before} ({at})"
        )


class Continuity:
    """Watches the ticks of one loop.

    Args:
        loop: its name.
    """

    def __init__(self, loop: str) -> None:
        self.loop = loop
        self._last, self._last_ns = -1, 0
        self._began = False

    def take(self, index: int, skipped: int, release_ns: int) -> Gap | None:
        """Note a tick; returns the gap before it, if there is one."""
        missing = index - self._last - 1 - skipped
        gap = None
        if missing != 0:
            begin_ns = self._last_ns if self._began else release_ns
            gap = Gap(self.loop, self._last, index, max(0, missing), begin_ns, release_ns)
        self._last, self._last_ns, self._began = index, release_ns, True
        return gap
