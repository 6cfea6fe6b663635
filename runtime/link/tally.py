# SPDX-License-Identifier: Apache-2.0
"""Counts what became of every message that arrived."""

from __future__ import annotations

import threading
from collections import Counter


class Tally:
    """Messages by topic; any thread may count.

    Attributes:
        accepted: by topic.
        rejected: by topic and reason.
        lost: that never arrived, by topic, as far as their senders number them.
        last_ns: when the last accepted one of each topic came, monotonic.
    """

    def __init__(self) -> None:
        self.accepted: Counter[str] = Counter()
        self.rejected: Counter[tuple[str, str]] = Counter()
        self.lost: Counter[str] = Counter()
        self.last_ns: dict[str, int] = {}
        self._lock = threading.Lock()

    def accept(self, topic: str, now_ns: int) -> None:
        """Count a message that was used."""
        with self._lock:
            self.accepted[topic] += 1
            self.last_ns[topic] = now_ns

    def reject(self, topic: str, reason: str) -> None:
        """Count a message that was not used, or only in part."""
        with self._lock:
            self.rejected[topic, reason] += 1

    def miss(self, topic: str, number: int) -> None:
        """Count messages that never arrived."""
        if number:
            with self._lock:
                self.lost[topic] += number

    def snapshot(self) -> tuple[dict[str, int], dict[tuple[str, str], int], dict[str, int]]:
        """Accepted, rejected and lost so far."""
        with self._lock:
            return dict(self.accepted), dict(self.rejected), dict(self.lost)
