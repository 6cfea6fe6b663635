# SPDX-License-Identifier: Apache-2.0
"""A bound on how often something may happen."""

from __future__ import annotations

_NS_PER_SECOND = 1_000_000_000


class RateGate:
    """Lets through so many a second, and a burst of some at once.

    Args:
        rate_hz: in the long run.
        burst: at once, at least 1.
    """

    def __init__(self, rate_hz: float, burst: int) -> None:
        self._period_ns = round(_NS_PER_SECOND / rate_hz)
        self._ahead_ns = (burst - 1) * self._period_ns
        self._due_ns = -self._ahead_ns

    def passes(self, now_ns: int) -> bool:
        """Whether one more may pass now, which then has passed."""
        if now_ns < self._due_ns - self._ahead_ns:
            return False
        self._due_ns = max(self._due_ns, now_ns) + self._period_ns
        return True
