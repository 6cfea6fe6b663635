# SPDX-License-Identifier: Apache-2.0
"""The lockstep executor: every loop in one thread, in virtual time, in a fixed order, as fast as it can.

Results of a loop become visible to other loops, and its frames leave on the bus, at release + budget, exactly as in
real time; between events the world (a simulator on the far end of the wires) is advanced to the event's time.
"""

from __future__ import annotations

import gc
import heapq
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from runtime.executors.tick import ENTRY, Manifest, Tick, manifest_of, tick_record
from runtime.records import Record
from runtime.tasks import Loop, due


class InputPort(Protocol):
    """Where bytes enter a loop."""

    def read(self, record: Any, now_ns: int) -> bool:
        """Fill the record with what arrived up to now; False if nothing did."""


class OutputPort(Protocol):
    """Where bytes leave a loop."""

    def write(self, record: Any, now_ns: int) -> None:
        """Send the record's content."""


class World(Protocol):
    """What is on the far end of the wires."""

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass."""


class TickSink(Protocol):
    """Takes one datagram per tick."""

    def write(self, datagram: bytes) -> None:
        """Record it."""


@dataclass
class _Mailbox:
    """A record on its way from the loop that writes it to one that receives it."""

    target: Record
    sequence: int = 0
    pending: list[tuple[int, int, bytes]] = field(default_factory=list)

    def deliver(self, now_ns: int) -> int:
        """Make the newest value due by now visible; returns its sequence number."""
        while self.pending and self.pending[0][0] <= now_ns:
            _, self.sequence, body = self.pending.pop(0)
            self.target.load(body)
        return self.sequence


class _LoopRun:
    """A loop with what the executor needs to step and log it."""

    def __init__(self, loop: Loop, manifest: Manifest, key_frame_ns: int) -> None:
        self.loop = loop
        self.index = 0
        self.compute_ns: list[int] = []
        self.tick: Tick = tick_record(loop)
        self.mailboxes = [_Mailbox(record) for record in loop.receives]
        self.subscribers: dict[str, list[_Mailbox]] = {}
        self.channel = {channel.record.topic: channel.number for channel in manifest.channels}
        self.last_logged: dict[str, bytes] = {}
        self.key_frame_every = max(1, key_frame_ns // loop.period_ns)

    @property
    def release_ns(self) -> int:
        return self.index * self.loop.period_ns

    def entry(self, record: Record) -> bytes:
        """One datagram entry."""
        body = record.to_bytes()
        return ENTRY.pack(self.channel[record.topic], len(body)) + body


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Without the cyclic garbage collector, as the loops run on the robot; steps leave no cycles behind."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _release_ns(run: _LoopRun) -> int:
    return run.release_ns


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
        self._runs = [_LoopRun(loop, self.manifest, key_frame_ns) for loop in loops]
        self._input_ports, self._output_ports = input_ports, output_ports
        self._world, self._sink = world, sink
        self._departures: list[tuple[int, int, Record, bytes]] = []
        self._scratch = {record.topic: record.like() for loop in loops for record in loop.port_outputs}
        self._departure_count = 0
        for writer in self._runs:
            for reader in self._runs:
                for mailbox in reader.mailboxes:
                    if any(record.topic == mailbox.target.topic for record in writer.loop.writes):
                        writer.subscribers.setdefault(mailbox.target.topic, []).append(mailbox)

    @property
    def compute_ns(self) -> dict[str, list[int]]:
        """Wall time of each step so far, by loop."""
        return {run.loop.name: run.compute_ns for run in self._runs}

    def run(self, until_ns: int, stop: Callable[[int], bool]) -> int:
        """Take every step released before `until_ns`, or until `stop(now_ns)` says so; returns the time reached."""
        with _collector_paused():
            while True:
                run = min(self._runs, key=_release_ns)
                now_ns = min(run.release_ns, until_ns)
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

    def _step(self, run: _LoopRun, now_ns: int) -> None:
        loop, tick = run.loop, run.tick
        logged = [record for record in loop.port_inputs if self._input_ports[record.topic].read(record, now_ns)]
        tick.consumed = [mailbox.deliver(now_ns) for mailbox in run.mailboxes]
        states = self._key_frame(run) if run.index and run.index % run.key_frame_every == 0 else []
        began = time.perf_counter_ns()
        for item in loop.schedule:
            if due(item, run.index):
                item.task.step(now_ns)
                logged += item.task.writes
        tick.compute_ns = time.perf_counter_ns() - began
        run.compute_ns.append(tick.compute_ns)
        tick.index, tick.release_ns, tick.now_ns = run.index, now_ns, now_ns
        self._publish(run, now_ns + loop.budget_ns)
        self._log(run, states, logged)
        run.index += 1

    def _key_frame(self, run: _LoopRun) -> list[bytes]:
        """Log every state as it is before the step, and take it up again."""
        states = []
        for item in run.loop.schedule:
            item.task.restore(item.task.save())
            if item.task.state is not None:
                states.append(run.entry(item.task.state))
        return states

    def _publish(self, run: _LoopRun, visible_ns: int) -> None:
        sequence = run.index + 1
        for item in run.loop.schedule:
            if due(item, run.index):
                for record in item.task.writes:
                    for mailbox in run.subscribers.get(record.topic, ()):
                        mailbox.pending.append((visible_ns, sequence, record.to_bytes()))
        for record in run.loop.port_outputs:
            self._departure_count += 1
            heapq.heappush(self._departures, (visible_ns, self._departure_count, record, record.to_bytes()))

    def _log(self, run: _LoopRun, states: Sequence[bytes], records: Sequence[Record]) -> None:
        parts = [run.entry(run.tick), *states]
        for record in records:
            entry = run.entry(record)
            if record.on_change:
                if run.last_logged.get(record.topic) == entry:
                    continue
                run.last_logged[record.topic] = entry
            parts.append(entry)
        self._sink.write(b"".join(parts))
