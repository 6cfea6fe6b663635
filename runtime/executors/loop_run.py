# SPDX-License-Identifier: Apache-2.0
"""What every executor does with a loop: pass signals on at their time, step the tasks, log what they saw and gave."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from runtime.executors.tick import Manifest, Tick, header, tick_record
from runtime.executors.timing import TimingPort
from runtime.records import Record
from runtime.signals import LoopTiming
from runtime.tasks import Loop, due

MOST_PENDING = 1024
"""Values that wait in a mailbox: many times those of one period of the slowest loop."""


class InputPort(Protocol):
    """Where bytes enter a loop."""

    def read(self, record: Any, now_ns: int) -> bool:
        """Fill the record with what arrived up to now; False if nothing did."""


class OutputPort(Protocol):
    """Where bytes leave a loop."""

    def write(self, record: Any, now_ns: int) -> None:
        """Send the record's content."""


class TickSink(Protocol):
    """Takes one datagram per tick.

    Attributes:
        dropped: datagrams that it could not take since start.
    """

    @property
    def dropped(self) -> int:
        """See above."""

    def write(self, datagram: bytes) -> None:
        """Record it."""


class Mailbox:
    """A record on its way from the loop that writes it to one that receives it; each end may have its own thread.

    Of a receiver that stopped, it keeps the newest values only.
    """

    def __init__(self, target: Record) -> None:
        self.target = target
        self._sequence = 0
        self._pending: deque[tuple[int, int, bytes]] = deque(maxlen=MOST_PENDING)

    def post(self, visible_ns: int, sequence: int, body: bytes) -> None:
        """Send a value that becomes visible at a time."""
        self._pending.append((visible_ns, sequence, body))

    def deliver(self, now_ns: int) -> int:
        """Make the newest value due by now visible; returns its sequence number."""
        newest = None
        while self._pending and self._pending[0][0] <= now_ns:
            _, self._sequence, newest = self._pending.popleft()
        if newest is not None:
            self.target.load(newest)
        return self._sequence


class LoopRun:
    """A loop with what an executor needs to step and log it.

    Attributes:
        loop: as given.
        index: number of the next tick.
        tick: record of the present tick.
        mailboxes: of the signals that the loop receives.
    """

    def __init__(
        self, loop: Loop, manifest: Manifest, key_frame_ns: int, input_ports: Mapping[str, InputPort], sink: TickSink
    ) -> None:
        self.loop = loop
        self.index = 0
        self.tick: Tick = tick_record(loop)
        self.mailboxes = [Mailbox(record) for record in loop.receives]
        self._timing = TimingPort(loop.period_ns)
        self._inputs = [
            (record, self._timing if isinstance(record, LoopTiming) else input_ports[record.topic])
            for record in loop.port_inputs
        ]
        self._sink = sink
        self._subscribers: dict[str, list[Mailbox]] = {}
        self._headers = {channel.record.topic: header(channel.number, channel.record) for channel in manifest.channels}
        self._last_logged: dict[str, bytes] = {}
        self._key_frame_every = max(1, key_frame_ns // loop.period_ns)
        self._key_frames = 0
        self._states: list[bytes] = []
        self._read: list[Record] = []
        self._written: list[tuple[Record, bytes]] = []
        self._lasting: dict[str, Record] = {}

    def feed(self, reader: LoopRun) -> None:
        """Let another loop receive what this one writes."""
        written = {record.topic for record in self.loop.writes}
        for mailbox in reader.mailboxes:
            if mailbox.target.topic in written:
                self._subscribers.setdefault(mailbox.target.topic, []).append(mailbox)

    def step(self, now_ns: int, boot_ns: int) -> None:
        """Read the ports, receive, and step the tasks that are due.

        Args:
            now_ns: the present.
            boot_ns: the same by the clock that goes on while the computer is suspended.
        """
        tick = self.tick
        self._timing.begin(tick.skipped, boot_ns)
        self._read = [record for record, port in self._inputs if port.read(record, now_ns)]
        self._lasting.update((record.topic, record) for record in self._read)
        tick.consumed = [mailbox.deliver(now_ns) for mailbox in self.mailboxes]
        self._states = self._key_frame() if self._key_frame_due() else []
        self._written.clear()
        began, began_cpu = time.perf_counter_ns(), time.thread_time_ns()
        for item in self.loop.schedule:
            if due(item, self.index):
                item.task.step(now_ns)
                self._written += [(record, record.to_bytes()) for record in item.task.writes]
        tick.cpu_ns = time.thread_time_ns() - began_cpu
        tick.compute_ns = time.perf_counter_ns() - began
        tick.index, tick.now_ns = self.index, now_ns

    def publish(self, visible_ns: int) -> None:
        """Send what this tick wrote to the loops that receive it."""
        for record, body in self._written:
            for mailbox in self._subscribers.get(record.topic, ()):
                mailbox.post(visible_ns, self.index + 1, body)

    def log(self) -> None:
        """Hand the tick to the sink as one datagram: its record, the states of a key-frame, and the signals."""
        self.tick.dropped = self._sink.dropped
        parts = [self._headers[self.tick.topic], self.tick.to_bytes(), *self._states]
        for record, body in (*((record, record.to_bytes()) for record in self._read), *self._written):
            topic = record.topic
            if record.on_change:
                if self._last_logged.get(topic) == body:
                    continue
                self._last_logged[topic] = body
            parts += (self._headers[topic], body)
        self._sink.write(b"".join(parts))

    def _key_frame_due(self) -> bool:
        """Whether an interval has begun since the last one; ticks may have been skipped meanwhile."""
        number = self.index // self._key_frame_every
        began = number > self._key_frames
        self._key_frames = number
        return began

    def _key_frame(self) -> list[bytes]:
        """Every state as it is before the step; it is taken up again, as a replay will take it up.

        Inputs that hold since an earlier tick are logged again with this one, for a log that begins or goes on here.
        """
        self._last_logged.clear()
        self._read += [record for record in self._lasting.values() if record not in self._read]
        states: list[bytes] = []
        for item in self.loop.schedule:
            item.task.restore(item.task.save())
            if item.task.state is not None:
                states += (self._headers[item.task.state.topic], item.task.state.to_bytes())
        return states


def connected(
    loops: Sequence[Loop],
    manifest: Manifest,
    key_frame_ns: int,
    input_ports: Mapping[str, InputPort],
    sink: TickSink,
) -> list[LoopRun]:
    """Runs of loops that receive from each other."""
    runs = [LoopRun(loop, manifest, key_frame_ns, input_ports, sink) for loop in loops]
    for writer in runs:
        for reader in runs:
            writer.feed(reader)
    return runs
