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
    """Gives a loop its own overruns, as an input port."""

    def __init__(self) -> None:
        self._overruns = self._skipped = self._in_a_row = 0
        self._news = False

    def begin(self, skipped: int) -> None:
        """Note a tick before which so many periods were skipped."""
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
        record.overruns_in_a_row = self._in_a_row
        return True
