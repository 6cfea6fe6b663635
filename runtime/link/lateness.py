# SPDX-License-Identifier: Apache-2.0
"""How long a message was on its way, as far as that can be known without a common clock.

The quickest message of a publisher so far counts as not late. What waited in a broken network, and arrives when that
is mended, is late against it. A sender's clock that is set looks the same at first; but the next message is then as
late as the one before, though it comes in its own time, and counts as not late again.
"""

from __future__ import annotations

DRIFT = 1000
"""Clocks part by less than one part in so many."""
STEADY_NS = 500_000_000
"""Messages at least so far apart, whose ways differ by less, come in their own time."""


class Lateness:
    """Of one publisher's messages, in the order of their arrival."""

    def __init__(self) -> None:
        self._quickest_ns: int | None = None
        self._sent_ns = self._arrival_ns = 0

    def of(self, sent_ns: int, arrival_ns: int) -> int:
        """How much longer a message was on its way than the quickest, ns.

        Args:
            sent_ns: when it was sent, by the sender's clock.
            arrival_ns: when it arrived, by the monotonic clock here.
        """
        took_ns, since_ns = arrival_ns - sent_ns, arrival_ns - self._arrival_ns
        grown_ns, set_back = took_ns - (self._arrival_ns - self._sent_ns), sent_ns < self._sent_ns
        steady = since_ns >= STEADY_NS > abs(grown_ns)
        if self._quickest_ns is None or set_back or steady:
            self._quickest_ns = took_ns
        else:
            self._quickest_ns = min(took_ns, self._quickest_ns + since_ns // DRIFT)
        self._sent_ns, self._arrival_ns = sent_ns, arrival_ns
        return took_ns - self._quickest_ns
