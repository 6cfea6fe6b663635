# SPDX-License-Identifier: Apache-2.0
"""Keeps processes running as a service manager does: started in order, started again when they end or fall silent.

One that does not come up holds up those behind it only until that is known, and forbids none of them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from runtime.executors.processes import how_it_ended

ABORT_WITHIN_S = 1.0
"""Time to end for one that has fallen silent, before it is killed."""


class Service(NamedTuple):
    """A process that is to run all the time.

    Attributes:
        name: of it.
        command: that starts it.
        ready_within_s: it says by then that it is ready, or is ended.
        silent_for_s: it is ended if, once ready, it does not say for so long that it is alive.
        pause_s: between its end and its next start.
        starts: more than so many within `within_s` are not tried.
        within_s: see `starts`.
    """

    name: str
    command: Sequence[str]
    ready_within_s: float
    silent_for_s: float
    pause_s: float
    starts: int
    within_s: float


class Pool(Protocol):
    """What runs the processes: see `Processes`."""

    @property
    def ended(self) -> dict[str, int]:
        """Names and return codes of those that have ended by themselves."""

    def start(self, name: str, command: Sequence[str]) -> object:
        """Start a process."""

    def told(self, name: str) -> list[str]:
        """What one has told its service manager since the last look."""

    def stop(self, name: str, within_s: float = ...) -> int:
        """End one; returns its code."""


class _Kept:
    """A service, and how it stands: `settled` once it was ready or has failed, so that the next may start."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.running = self.ready = self.settled = False
        self.due_s = -math.inf
        self.heard_s = 0.0
        self.started_s: deque[float] = deque(maxlen=service.starts)

    def may_start(self, now_s: float) -> bool:
        full = len(self.started_s) == self.service.starts
        return not full or now_s - self.started_s[0] >= self.service.within_s

    def listen(self, words: Sequence[str], now_s: float) -> None:
        self.ready |= "READY=1" in words
        if "READY=1" in words or "WATCHDOG=1" in words:
            self.heard_s = now_s

    def silence(self, now_s: float) -> str:
        """Why it is to be ended, if it is."""
        if not self.ready and now_s - self.heard_s > self.service.ready_within_s:
            return f"is not ready after {self.service.ready_within_s:g} s"
        if self.ready and now_s - self.heard_s > self.service.silent_for_s:
            return f"has not said for {self.service.silent_for_s:g} s that it is alive"
        return ""


class Supervisor:
    """Starts services in their order and keeps them running.

    Args:
        services: in the order in which they start; they are stopped in the opposite one.
        pool: runs their processes.
        say: told of each start, end and stop, a sentence at a time.

    Attributes:
        given_up: names of those that ended too often.
    """

    def __init__(self, services: Sequence[Service], pool: Pool, say: Callable[[str], None]) -> None:
        self._kept, self._pool, self._say = [_Kept(service) for service in services], pool, say
        self.given_up: set[str] = set()

    def look(self, now_s: float) -> None:
        """Do what is due, given the monotonic time."""
        ended = self._pool.ended
        for kept in self._kept:
            if kept.running:
                self._watch(kept, ended.get(kept.service.name), now_s)
            elif now_s >= kept.due_s:
                self._start(kept, now_s)
            if not kept.settled:
                return

    def _start(self, kept: _Kept, now_s: float) -> None:
        service = kept.service
        if not kept.may_start(now_s):
            kept.due_s = math.inf
            self.given_up.add(service.name)
            self._say(
                f"the process {service.name} is given up after {service.starts} starts within {service.within_s:g} s"
            )
            return
        self._pool.start(service.name, service.command)
        kept.running, kept.ready, kept.heard_s = True, False, now_s
        kept.started_s.append(now_s)
        self._say(f"the process {service.name} is started")

    def _watch(self, kept: _Kept, code: int | None, now_s: float) -> None:
        name, was_ready = kept.service.name, kept.ready
        kept.listen(self._pool.told(name), now_s)
        if kept.ready and not was_ready:
            kept.settled = True
            self._say(f"the process {name} is ready")
        why = kept.silence(now_s) if code is None else how_it_ended(code)
        if why:
            self._pool.stop(name, ABORT_WITHIN_S)
            kept.running, kept.settled, kept.due_s = False, True, now_s + kept.service.pause_s
            self._say(f"the process {name} {why}; it is to be started again in {kept.service.pause_s:g} s")

    def stop(self) -> None:
        """End those that run, the last of the order first, each before the next."""
        for kept in reversed(self._kept):
            if kept.running:
                kept.running = False
                code = self._pool.stop(kept.service.name)
                self._say(f"the process {kept.service.name} was told to stop and {how_it_ended(code)}")
