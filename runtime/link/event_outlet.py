# SPDX-License-Identifier: Apache-2.0
"""Operators' requests on their way to the control loop, which takes one a tick: none waits behind a flood of others.

Requests leave at a bounded rate, in their order. While some wait, a newer one of the same sender and kind takes the
place of the older. An emergency stop does not wait for other requests and has a rate of its own, so that there are
never more before it than the few that have left but not been taken. Resets that wait when it comes are dropped: what
was said before it must not undo it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple

from runtime.link.rate_gate import RateGate
from runtime.messages.errors import MessageError
from runtime.signals import Motion, OperatorEvent, Request

MOST_WAITING = 64
BURST = 4
"""Requests that leave at once."""


class Event(NamedTuple):
    """One request of one sender, as in `OperatorEvent`."""

    stamp_ns: int
    source: int
    priority: int
    request: Request
    motion: Motion = Motion.REST
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)


class EventOutlet:
    """Writes requests at a bounded rate; any thread may offer one.

    Args:
        record: that is filled and written.
        write: hands it to the control loop.
        taken_hz: how many requests a second the control loop takes.

    Attributes:
        merged: requests whose place a newer one took, or that a stop overtook, since start.
        written: requests that left, since start.
    """

    def __init__(self, record: OperatorEvent, write: Callable[[OperatorEvent], None], taken_hz: float) -> None:
        self.merged = self.written = 0
        self._record, self._write = record, write
        self._gate, self._stop_gate = RateGate(taken_hz / 2, BURST), RateGate(taken_hz / 4, BURST)
        self._waiting: dict[tuple[int, Request], Event] = {}
        self._lock = threading.Lock()

    def offer(self, event: Event, now_ns: int) -> None:
        """Let a request leave, now or as soon as its turn comes.

        Raises:
            MessageError: if too many wait.
        """
        stop = event.request == Request.EMERGENCY_STOP
        # stops differ by nothing that counts, so that those of many senders are one
        key = (0 if stop else event.source, event.request)
        with self._lock:
            if stop:
                self._drop_resets()
            if self._waiting.pop(key, None) is not None:
                self.merged += 1
            elif not stop and len(self._waiting) >= MOST_WAITING:
                raise MessageError("too many requests wait")
            self._waiting[key] = event
            self._let_go(now_ns)

    def flush(self, now_ns: int) -> None:
        """Let go what has waited long enough."""
        with self._lock:
            self._let_go(now_ns)

    @property
    def waiting(self) -> int:
        """Requests that wait."""
        return len(self._waiting)

    def _drop_resets(self) -> None:
        for key in [key for key in self._waiting if key[1] == Request.RESET]:
            del self._waiting[key]
            self.merged += 1

    def _let_go(self, now_ns: int) -> None:
        stop = (0, Request.EMERGENCY_STOP)
        if stop in self._waiting and self._stop_gate.passes(now_ns):
            self._emit(self._waiting.pop(stop))
        for key in [key for key in self._waiting if key != stop]:
            if not self._gate.passes(now_ns):
                return
            self._emit(self._waiting.pop(key))

    def _emit(self, event: Event) -> None:
        record = self._record
        record.stamp_ns, record.source, record.priority = event.stamp_ns, event.source, event.priority
        record.request, record.motion, record.velocity = event.request, event.motion, event.velocity
        self.written += 1
        record.sequence = self.written  # two may have come at the same time
        self._write(record)
