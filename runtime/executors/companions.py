# SPDX-License-Identifier: Apache-2.0
"""The loops of other processes beside the robot's own: they have no tasks, but their ticks are logged with the others.

A process that stalls stops what it carries to or from the control loops. The ticks tell which one it was.
"""

from __future__ import annotations

from collections.abc import Sequence

from runtime.executors.loop_run import TickSink
from runtime.executors.tick import header, manifest_of, tick_record
from runtime.executors.timing import next_tick
from runtime.records import Record
from runtime.tasks import Loop

SIM = Loop("sim", 10_000_000, 10_000_000, 50, (), (), (), ())
"""Stands in for the robot. No process may have a priority between those of the control loops: it could hold up one that
has the interpreter while another waits for it."""


class CompanionTicks:
    """Keeps the time of a companion, and logs its ticks.

    Args:
        loops: those before it in the manifest of the log.
        companion: its loop.
        sink: takes the datagrams.
        start_ns: first release, on the monotonic clock.
    """

    def __init__(self, loops: Sequence[Loop], companion: Loop, sink: TickSink, start_ns: int) -> None:
        self._period_ns, self._start_ns, self._sink = companion.period_ns, start_ns, sink
        self._tick = tick_record(companion)
        channels = manifest_of((*loops, companion)).channels
        self._headers = {channel.record.topic: header(channel.number, channel.record) for channel in channels}
        self._index = 0

    @property
    def release_ns(self) -> int:
        """When the next tick is due."""
        return self._start_ns + self._index * self._period_ns

    @property
    def index(self) -> int:
        """Number of the next tick."""
        return self._index

    def done(self, began_ns: int, done_ns: int, cpu_ns: int, *records: Record) -> None:
        """Log a tick that was due at `release_ns`, and records of the companion's own; go on to the next not past."""
        self.log(self.release_ns, began_ns, done_ns, cpu_ns, done_ns, *records)

    def log(self, due_ns: int, began_ns: int, done_ns: int, cpu_ns: int, now_ns: int, *records: Record) -> None:
        """As `done`, for a companion that steps more often than it ticks and tells of one of its steps.

        Args:
            due_ns: when the step should have begun.
            began_ns: when it began.
            done_ns: when it was done.
            cpu_ns: processor time of it, 0 if not measured.
            now_ns: the present.
            records: of the companion's own.
        """
        tick = self._tick
        tick.index, tick.release_ns, tick.now_ns = self._index, due_ns, began_ns
        tick.wake_latency_ns, tick.compute_ns, tick.cpu_ns = began_ns - due_ns, done_ns - began_ns, cpu_ns
        tick.late, tick.dropped = now_ns > self.release_ns + self._period_ns, self._sink.dropped
        entries = ((self._headers[record.topic], record.to_bytes()) for record in (tick, *records))
        self._sink.write(b"".join(part for entry in entries for part in entry))
        self._index, tick.skipped = next_tick(self._index, self._start_ns, self._period_ns, now_ns)
