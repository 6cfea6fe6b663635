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
from runtime.executors.timing import next_tick
from runtime.records import Record
from runtime.tasks import Loop

Delays = Callable[[str, int], int]
"""How long after its release the step of a loop (by name) at an index is done, ns; for faults that are injected."""


def no_delay(loop: str, index: int) -> int:
    """Every step is done within its budget."""
    return 0


class World(Protocol):
    """What is on the far end of the wires."""

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass."""


class Lockstep:
    """Steps loops in virtual time.

    Args:
        loops: in the order in which loops released at the same instant run.
        input_ports, output_ports: by topic; every port record of the loops needs one.
        world: advanced to each event.
        sink: takes the datagrams.
        key_frame_ns: how often every task's state is logged and taken up again.
        delays: of the steps. Results that are late leave when they are done, and a step that takes longer than the
            period has the loop skip whole periods, exactly as in real time.
        start_ns: release of the first ticks.
        suspended: gives for how long the world went on without the loops.

    Attributes:
        manifest: of the datagrams.
        compute_ns: wall time of each step so far, by loop.
    """

    def __init__(
        self,
        loops: Sequence[Loop],
        input_ports: Mapping[str, InputPort],
        output_ports: Mapping[str, OutputPort],
        world: World,
        sink: TickSink,
        key_frame_ns: int = 1_000_000_000,
        delays: Delays = no_delay,
        start_ns: int = 0,
        suspended: Callable[[], int] = lambda: 0,
    ) -> None:
        self.manifest = manifest_of(tuple(loops))
        self._runs = connected(loops, self.manifest, key_frame_ns, input_ports, sink)
        self._output_ports, self._world = output_ports, world
        self._departures: list[tuple[int, int, Record, bytes]] = []
        self._scratch = {record.topic: record.like() for loop in loops for record in loop.port_outputs}
        self._departure_count = 0
        self._delays, self._start_ns, self._suspended = delays, start_ns, suspended
        self.compute_ns: dict[str, list[int]] = {loop.name: [] for loop in loops}

    def run(self, until_ns: int, stop: Callable[[int], bool]) -> int:
        """Take every step released before `until_ns`, or until `stop(now_ns)` says so; returns the time reached."""
        with collector_paused():
            while True:
                run = min(self._runs, key=self._release_ns)
                now_ns = min(self._release_ns(run), until_ns)
                self._depart(now_ns)
                self._world.advance(now_ns)
                if now_ns == until_ns or stop(now_ns):
                    return now_ns
                self._step(run, now_ns)

    def _release_ns(self, run: LoopRun) -> int:
        return self._start_ns + run.index * run.loop.period_ns

    def _depart(self, now_ns: int) -> None:
        while self._departures and self._departures[0][0] <= now_ns:
            due_ns, _, record, body = heapq.heappop(self._departures)
            self._world.advance(due_ns)
            departing = self._scratch[record.topic]
            departing.load(body)
            self._output_ports[record.topic].write(departing, due_ns)

    def _step(self, run: LoopRun, now_ns: int) -> None:
        tick, loop = run.tick, run.loop
        done_ns = now_ns + self._delays(loop.name, run.index)
        visible_ns = max(done_ns, now_ns + loop.budget_ns)
        tick.release_ns, tick.late = now_ns, done_ns > now_ns + loop.budget_ns
        run.step(now_ns, now_ns + self._suspended())
        self.compute_ns[loop.name].append(tick.compute_ns)
        run.publish(visible_ns)
        for record in loop.port_outputs:
            self._departure_count += 1
            heapq.heappush(self._departures, (visible_ns, self._departure_count, record, record.to_bytes()))
        run.log()
        run.index, tick.skipped = next_tick(run.index, self._start_ns, loop.period_ns, done_ns)
