# SPDX-License-Identifier: Apache-2.0
"""Two clocks: messages are stamped in unix time, which can be set; the loops count in monotonic time, which cannot."""

from __future__ import annotations

import time
from typing import NamedTuple

from runtime.messages.errors import MessageError


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
    """Turns the stamps of one sender into monotonic time, and takes none that is out of the window or of order.

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
