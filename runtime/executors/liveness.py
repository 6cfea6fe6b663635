# SPDX-License-Identifier: Apache-2.0
"""Tells the service manager of the loops: ready when they keep time, alive as long as every one of them advances."""

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
        self._on_time, self._ready = 0, False
        self._before: Sequence[int] = ()
        self._due_ns = 0

    def ticked(self, indices: Sequence[int], on_time: bool, now_ns: int) -> None:
        """Note one tick of the watching loop.

        Args:
            indices: number of the next tick of each loop.
            on_time: no period was skipped before this tick.
            now_ns: the present.
        """
        self._on_time = self._on_time + 1 if on_time else 0
        if not self._ready and self._on_time >= READY_AFTER_TICKS:
            self._ready = True
            self._notifier.send("READY=1")
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + ALIVE_EVERY_NS
        if self._before and all(now > before for now, before in zip(indices, self._before, strict=True)):
            self._notifier.send("WATCHDOG=1")
        self._before = indices
