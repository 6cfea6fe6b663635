# SPDX-License-Identifier: Apache-2.0
"""Two clocks: messages are stamped in unix time, which can be set; the loops count in monotonic time, which cannot."""

from __future__ import annotations

import time
from typing import NamedTuple

from runtime.messages.errors import MessageError

_STEP_NS = 10_000_000
"""A change between clocks from one look to the next that no steering of a clock makes."""


class Instant(NamedTuple):
    """The present, on both clocks."""

    monotonic_ns: int
    unix_ns: int

    def unix(self, monotonic_ns: int) -> int:
        """A monotonic time as unix time."""
        return monotonic_ns + self.unix_ns - self.monotonic_ns


def instant() -> Instant:
    """The present."""
    return Instant(time.monotonic_ns(), time.time_ns())


class StampWindow:
    """Turns the stamps of one topic into monotonic time, and takes none that is out of the window or of order.

    Order is judged in monotonic time too, so that a step of the unix clock costs at most the messages that were on
    their way.

    Args:
        age_max_ns: older stamps are refused.
        future_max_ns: stamps further ahead are refused; one that is less ahead counts as of now.
    """

    def __init__(self, age_max_ns: int, future_max_ns: int) -> None:
        self._age_max_ns, self._future_max_ns = age_max_ns, future_max_ns
        self._last = Instant(-1, -1)

    def monotonic_ns(self, stamp_ns: int, now: Instant) -> int:
        """A stamp in monotonic time; a stamp of zero means now.

        Raises:
            MessageError: if the stamp cannot be used.
        """
        age_ns = now.unix_ns - stamp_ns if stamp_ns else 0
        if age_ns > self._age_max_ns:
            raise MessageError("the stamp is too old")
        if -age_ns > self._future_max_ns:
            raise MessageError("the stamp is in the future")
        found = Instant(now.monotonic_ns - max(age_ns, 0), stamp_ns)
        if stamp_ns and (found.monotonic_ns <= self._last.monotonic_ns or stamp_ns == self._last.unix_ns):
            raise MessageError("the stamp is not newer than the one before")
        self._last = found
        return found.monotonic_ns


class ClockWatch:
    """Counts what happens to the clocks between one look and the next.

    Attributes:
        steps: of the unix clock.
        suspends: of the machine.
    """

    def __init__(self) -> None:
        self.steps = self.suspends = 0
        self._offset_ns, self._asleep_ns = _differences()

    def look(self) -> None:
        """Compare the clocks again."""
        offset_ns, asleep_ns = _differences()
        suspended = asleep_ns - self._asleep_ns > _STEP_NS
        self.suspends += suspended
        self.steps += abs(offset_ns - self._offset_ns) > _STEP_NS and not suspended
        self._offset_ns, self._asleep_ns = offset_ns, asleep_ns


def _differences() -> tuple[int, int]:
    """Of the unix clock, and of the time since boot, to the monotonic clock; a preempted reading is taken again."""
    while True:
        before = time.monotonic_ns()
        unix_ns, boot_ns = time.time_ns(), time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        after = time.monotonic_ns()
        if after - before < _STEP_NS // 2:
            return unix_ns - before, boot_ns - before
