# SPDX-License-Identifier: Apache-2.0
"""The log as the sequence of ticks that it was recorded from."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field

from runtime.executors.tick import Manifest, Tick
from runtime.recording.bag import CHECKSUM_TOPIC_PREFIX
from runtime.recording.continuity import Continuity, Gap
from runtime.recording.log import Log


@dataclass
class LoggedTick:
    """One step of one loop, as recorded.

    Attributes:
        loop: name of the loop.
        index: number of the tick.
        skipped: whole periods skipped before it.
        now_ns: when it began.
        at_ns: the same, from the log's origin.
        consumed: sequence number of each received signal.
        gap: before it, if ticks of its loop are missing there.
        bodies: CDR bodies by topic: inputs, outputs and, at a key-frame, states.
        checksums: CRC-32 of each of the loop's channels, in their order; None if not logged.
    """

    loop: str
    index: int
    skipped: int
    now_ns: int
    at_ns: int
    consumed: tuple[int, ...]
    gap: Gap | None = None
    bodies: dict[str, memoryview] = field(default_factory=dict)
    checksums: memoryview | None = None


def logged_ticks(log: Log, manifest: Manifest, from_ns: int = 0) -> Iterator[LoggedTick]:
    """Every tick of the log, in the order in which they were recorded, or those from some log time on."""
    origin_ns = log.origin_ns
    loop_of = {channel.record.topic: channel.loop for channel in manifest.channels}
    sizes = {channel.record.topic: channel.record.cdr_size for channel in manifest.channels}
    ticks = {c.record.topic: c.record.like() for c in manifest.channels if c.role == "tick"}
    continuity = {channel.loop: Continuity(channel.loop) for channel in manifest.channels}
    checksum_loops = {CHECKSUM_TOPIC_PREFIX + channel.loop: channel.loop for channel in manifest.channels}
    current: LoggedTick | None = None
    for topic, _, log_ns, body in log.messages({*loop_of, *checksum_loops}, from_ns):
        if len(body) != sizes.get(topic, len(body)):
            log.note_damage(
                f"{topic} at {(log_ns - origin_ns) / 1e9:.3f} s has {len(body)} bytes instead of {sizes[topic]}"
            )
            continue
        record = ticks.get(topic)
        if isinstance(record, Tick):
            if current is not None:
                yield current
            record.load(body)
            current = LoggedTick(
                loop=loop_of[topic],
                index=record.index,
                skipped=record.skipped,
                now_ns=record.now_ns,
                at_ns=record.now_ns - origin_ns,
                consumed=tuple(record.consumed.tolist()),
                gap=continuity[loop_of[topic]].take(record.index, record.skipped, record.release_ns - origin_ns),
                bodies={topic: body},
            )
        elif current is None:
            continue
        elif topic in checksum_loops:
            if checksum_loops[topic] == current.loop:
                current.checksums = body
        elif loop_of[topic] == current.loop:
            current.bodies[topic] = body
    if current is not None:
        yield current


def damaged_topics(tick: LoggedTick, topics: list[str]) -> list[tuple[str, int]]:
    """Topics of a tick whose body does not match the checksum recorded with it, and that checksum.

    Args:
        tick: as logged.
        topics: those of the loop, in the order of its channels.
    """
    if tick.checksums is None or len(tick.checksums) != 4 * len(topics):
        return []
    damaged = []
    for topic, expected in zip(topics, tick.checksums.cast("I"), strict=True):
        body = tick.bodies.get(topic)
        if body is not None and zlib.crc32(body) != expected:
            damaged.append((topic, expected))
    return damaged


def flipped_bit(body: memoryview, expected: int) -> int | None:
    """The one bit (counted from the start of the body) whose flip explains the checksum, if one does."""
    data = bytearray(body)
    for bit in range(8 * len(data)):
        data[bit >> 3] ^= 1 << (bit & 7)
        if zlib.crc32(data) == expected:
            return bit
        data[bit >> 3] ^= 1 << (bit & 7)
    return None
