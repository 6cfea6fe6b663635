# SPDX-License-Identifier: Apache-2.0
"""How a loop keeps its time: which tick comes next when one took too long, and what the loop is told of it."""

from __future__ import annotations

from runtime.records import Record
from runtime.signals import LoopTiming


def next_tick(index: int, start_ns: int, period_ns: int, now_ns: int) -> tuple[int, int]:
    """The next tick that is released at or after now, and how many whole periods that skips."""
    following = max(index + 1, -(-(now_ns - start_ns) // period_ns))
    return following, following - index - 1


class TimingPort:
    """Gives a loop its own overruns, as an input port.

    Args:
        period_ns: of the loop.
    """

    def __init__(self, period_ns: int) -> None:
        self._least_gap_ns = 2 * period_ns
        self._overruns = self._skipped = self._in_a_row = 0
        self._boot_ns: int | None = None
        self._gap_ns = 0
        self._news = False

    def begin(self, skipped: int, boot_ns: int) -> None:
        """Note a tick.

        Args:
            skipped: periods before it that were skipped.
            boot_ns: its time by the clock that goes on while the computer is suspended; the monotonic one stands still
                then, so that nothing is skipped.
        """
        before_ns, self._boot_ns = self._boot_ns, boot_ns
        gap_ns = 0 if before_ns is None or boot_ns - before_ns <= self._least_gap_ns else boot_ns - before_ns
        self._news |= gap_ns != self._gap_ns
        self._gap_ns = gap_ns
        if skipped:
            self._overruns, self._skipped = self._overruns + 1, self._skipped + skipped
            self._in_a_row += 1
            self._news = True
        elif self._in_a_row:
            self._in_a_row = 0
            self._news = True

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record if something changed."""
        assert isinstance(record, LoopTiming)
        if not self._news:
            return False
        self._news = False
        record.overruns, record.skipped = self._overruns, self._skipped
        record.overruns_in_a_row, record.gap_ns = self._in_a_row, self._gap_ns
        return True
