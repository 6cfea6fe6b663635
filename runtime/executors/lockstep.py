# SPDX-License-Identifier: Apache-2.0
"""The lockstep executor: every loop in one thread, in virtual time, in a fixed order, as fast as it can.

Results of a loop become visible to other loops, and its frames leave on the bus, at release + budget, exactly as in
real time; between events the world (a simulator on the far end of the wires) is advanced to the event's time.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from runtime.executors.collector import collector_paused
from runtime.executors.loop_run import InputPort, LoopRun, OutputPort, TickSink, connected
from runtime.executors.tick import manifest_of
from runtime.records import Record
from runtime.tasks import Loop


class World(Protocol):
    """What is on the far end of the wires."""

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass."""


def _release_ns(run: LoopRun) -> int:
    return run.index * run.loop.period_ns


class Lockstep:
    """Steps loops in virtual time.

    Args:
        loops: in the order in which loops released at the same instant run.
        input_ports, output_ports: by topic; every port record of the loops needs one.
        world: advanced to each event.
        sink: takes the datagrams.
        key_frame_ns: how often every task's state is logged and taken up again.
    """

    def __init__(
        self,
        loops: Sequence[Loop],
        input_ports: Mapping[str, InputPort],
        output_ports: Mapping[str, OutputPort],
        world: World,
        sink: TickSink,
        key_frame_ns: int = 1_000_000_000,
    ) -> None:
        self.manifest = manifest_of(tuple(loops))
        self._runs = connected(loops, self.manifest, key_frame_ns, input_ports, sink)
        self._output_ports, self._world = output_ports, world
        self._departures: list[tuple[int, int, Record, bytes]] = []
        self._scratch = {record.topic: record.like() for loop in loops for record in loop.port_outputs}
        self._departure_count = 0

    @property
    def compute_ns(self) -> dict[str, list[int]]:
        """Wall time of each step so far, by loop."""
        return {run.loop.name: run.compute_ns for run in self._runs}

    def run(self, until_ns: int, stop: Callable[[int], bool]) -> int:
        """Take every step released before `until_ns`, or until `stop(now_ns)` says so; returns the time reached."""
        with collector_paused():
            while True:
                run = min(self._runs, key=_release_ns)
                now_ns = min(_release_ns(run), until_ns)
                self._depart(now_ns)
                self._world.advance(now_ns)
                if now_ns == until_ns or stop(now_ns):
                    return now_ns
                self._step(run, now_ns)

    def _depart(self, now_ns: int) -> None:
        while self._departures and self._departures[0][0] <= now_ns:
            due_ns, _, record, body = heapq.heappop(self._departures)
            self._world.advance(due_ns)
            departing = self._scratch[record.topic]
            departing.load(body)
            self._output_ports[record.topic].write(departing, due_ns)

    def _step(self, run: LoopRun, now_ns: int) -> None:
        run.tick.release_ns, visible_ns = now_ns, now_ns + run.loop.budget_ns
        run.step(now_ns)
        run.publish(visible_ns)
        for record in run.loop.port_outputs:
            self._departure_count += 1
            heapq.heappush(self._departures, (visible_ns, self._departure_count, record, record.to_bytes()))
        run.log()
        run.index += 1
