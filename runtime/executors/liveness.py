# SPDX-License-Identifier: Apache-2.0
"""Tells the service manager of the loops: ready when they keep time, alive as long as every one of them advances.

Loops that the system gives no real-time priority may never keep time for long. They are not waited for: they are ready
when they have run for a while, and the status says how well.
"""

from __future__ import annotations

from collections.abc import Sequence

from runtime.executors.notify import Notifier

READY_AFTER_TICKS = 100
ALIVE_EVERY_NS = 500_000_000
"""A quarter of the units' watchdog time."""


class Liveness:
    """Watches the tick numbers of all loops from within one of them, which itself must run for anything to be told.

    Args:
        notifier: to the service manager.
    """

    def __init__(self, notifier: Notifier) -> None:
        self._notifier = notifier
        self._ticks = self._on_time = self._in_a_row = 0
        self._ready, self._refusal = False, ""
        self._before: Sequence[int] = ()
        self._due_ns = 0

    def at_normal_priority(self, refusal: str) -> None:
        """Note, as a sentence, why a loop has no real-time priority; may be called from any thread."""
        self._refusal = refusal

    def ticked(self, indices: Sequence[int], on_time: bool, now_ns: int) -> None:
        """Note one tick of the watching loop.

        Args:
            indices: number of the next tick of each loop.
            on_time: no period was skipped before this tick.
            now_ns: the present.
        """
        if not self._ready:
            self._get_ready(on_time)
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + ALIVE_EVERY_NS
        if not self._ready:
            self._notifier.send(f"STATUS={self._in_a_row} ticks on time in a row; ready at {READY_AFTER_TICKS}")
        if self._before and all(now > before for now, before in zip(indices, self._before, strict=True)):
            self._notifier.send("WATCHDOG=1")
        self._before = indices

    def _get_ready(self, on_time: bool) -> None:
        self._ticks, self._on_time = self._ticks + 1, self._on_time + on_time
        self._in_a_row = self._in_a_row + 1 if on_time else 0
        if self._in_a_row >= READY_AFTER_TICKS:
            self._tell_ready("the loops keep time")
        elif self._refusal and self._ticks >= READY_AFTER_TICKS:
            self._tell_ready(f"{self._on_time} of the first {self._ticks} ticks were on time: {self._refusal}")

    def _tell_ready(self, status: str) -> None:
        self._ready = True
        self._notifier.send(f"STATUS={status}")
        self._notifier.send("READY=1")
