# SPDX-License-Identifier: Apache-2.0
"""What one step of a loop leaves behind: a tick record and the bytes of every signal it read or wrote, in one datagram.

A datagram is a sequence of entries `channel (u16), length (u16), body`, little-endian; the first entry is the tick
record. Channels are numbered by the `Manifest`, which a recorder is given before the first datagram.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from runtime.records import Record, int64, uint32, uint32_array
from runtime.tasks import Loop

ENTRY = struct.Struct("<HH")
TICK_TOPIC_PREFIX = "/ugv/tick/"


class Tick(Record):
    """How one step of a loop went."""

    index = int64("", "number of the tick, from 0")
    release_ns = int64("ns", "when the tick was due")
    now_ns = int64("ns", "when it began")
    skipped = uint32("", "whole periods skipped before it")
    late = uint32("", "1 if its results left after the budget")
    wake_latency_ns = int64("ns")
    compute_ns = int64("ns", "wall time of its tasks; differs from run to run")
    cpu_ns = int64(
        "ns", "processor time of its tasks, 0 if not measured; the rest of compute_ns the loop was kept from"
    )
    dropped = uint32("", "datagrams that the recorder could not take, since start")
    consumed = uint32_array("received", "", "sequence number of each received signal, 0 for none yet")


@dataclass(frozen=True)
class Channel:
    """One topic of the log.

    Attributes:
        number: its number in datagrams.
        record: a record of its layout.
        loop: name of the loop whose ticks carry it.
        role: "tick", "input" (from a port), "received" (from another loop: not logged twice), "output" or "state".
    """

    number: int
    record: Record
    loop: str
    role: str


@dataclass(frozen=True)
class Manifest:
    """Every channel of a robot, in a fixed order that follows from its loops."""

    channels: tuple[Channel, ...]

    def of_topic(self, topic: str) -> Channel:
        """The channel of a topic; KeyError if there is none."""
        for channel in self.channels:
            if channel.record.topic == topic:
                return channel
        raise KeyError(topic)


def tick_record(loop: Loop) -> Tick:
    """A tick record for a loop."""
    return Tick(TICK_TOPIC_PREFIX + loop.name, {"received": len(loop.receives)})


def manifest_of(loops: tuple[Loop, ...]) -> Manifest:
    """Number every tick record, port input, written signal and task state of the loops."""
    rows: list[tuple[Record, str, str]] = []
    for loop in loops:
        rows.append((tick_record(loop), loop.name, "tick"))
        rows += [(record, loop.name, "input") for record in loop.port_inputs]
        rows += [(record, loop.name, "output") for record in loop.writes]
        for item in loop.schedule:
            if item.task.state is not None:
                rows.append((item.task.state, loop.name, "state"))
    return Manifest(tuple(Channel(number, *row) for number, row in enumerate(rows)))


def header(number: int, record: Record) -> bytes:
    """What comes before every body of a record in a datagram, under the number of its channel."""
    return ENTRY.pack(number, record.cdr_size)


def entries(datagram: bytes) -> Iterator[tuple[int, memoryview]]:
    """The (channel number, body) pairs of a datagram."""
    view, position = memoryview(datagram), 0
    while position < len(view):
        number, length = ENTRY.unpack_from(view, position)
        position += ENTRY.size
        yield number, view[position : position + length]
        position += length
