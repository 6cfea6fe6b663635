# SPDX-License-Identifier: Apache-2.0
"""Whether two logs hold the same: every signal, bit for bit, but for the wall times of the ticks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording.bag import CHECKSUM_TOPIC_PREFIX
from runtime.recording.layout import dtype_of
from runtime.recording.log import Log, Message

_WALL_TIMES = ("compute_ns", "cpu_ns", "wake_latency_ns")


def first_log_difference(one: Log, other: Log) -> str | None:
    """A sentence about the first message in which two logs differ, or None if they hold the same."""
    for ours, theirs in zip_longest(_comparable(one), _comparable(other)):
        if ours == theirs:
            continue
        if ours is None or theirs is None:
            shorter, longer = (one, theirs) if ours is None else (other, ours)
            assert longer is not None
            return f"{shorter.path} ends before {longer.topic} at {longer.log_ns / 1e9:.3f} s"
        place = f"{ours.topic} at {ours.log_ns / 1e9:.3f} s"
        if ours[:3] != theirs[:3]:
            return f"{one.path} goes on with {place}, {other.path} with {theirs.topic} at {theirs.log_ns / 1e9:.3f} s"
        return f"{place} differs between {one.path} and {other.path}"
    return None


def _comparable(log: Log) -> Iterator[Message]:
    """The messages of a log with the wall times blanked."""
    blanks: dict[str, list[slice]] = {}
    for topic, channel in log.channels.items():
        if topic.startswith(TICK_TOPIC_PREFIX):
            fields: Mapping[str, Any] = dtype_of(channel.definition).fields or {}
            blanks[topic] = [slice(int(fields[n][1]), int(fields[n][1]) + 8) for n in _WALL_TIMES if n in fields]
    for message in log.messages([topic for topic in log.channels if not topic.startswith(CHECKSUM_TOPIC_PREFIX)]):
        if message.topic in blanks:
            body = bytearray(message.body)
            for place in blanks[message.topic]:
                body[place] = bytes(8)
            message = message._replace(body=memoryview(body))
        yield message
