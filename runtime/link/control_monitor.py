# SPDX-License-Identifier: Apache-2.0
"""What the control loops do, from the datagrams of their ticks."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Mapping
from typing import TypeVar

from runtime.executors.tick import Manifest, Tick, entries
from runtime.link.loop_statistics import LoopStatistics
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import Imu

_KEPT = 1000
AnyRecord = TypeVar("AnyRecord", bound=Record)


class ControlMonitor:
    """Keeps the newest of every signal, and how the loops keep their time.

    Args:
        manifest: of the loops.

    Attributes:
        loops: statistics by loop.
        imu_age_ns: ages at which the last samples were used.
        imu_passed_over: samples that no tick used, since a newer one was there, or whose tick was not seen here.
        last_ns: when the last tick came, monotonic; None before the first.
        malformed: datagrams that are not of these loops, since start.
    """

    def __init__(self, manifest: Manifest) -> None:
        self._channels = {channel.number: channel for channel in manifest.channels}
        self._ticks = {
            channel.number: channel.record for channel in manifest.channels if isinstance(channel.record, Tick)
        }
        self._names = {channel.number: channel.loop for channel in manifest.channels}
        self._bodies: dict[str, bytes] = {}
        self._records: Mapping[str, Record] = {c.record.topic: c.record.like() for c in manifest.channels}
        self.loops = {name: LoopStatistics() for name in self._names.values()}
        self.imu_age_ns: deque[int] = deque(maxlen=_KEPT)
        self.imu_passed_over = self._imu_sequence = 0
        self.last_ns: int | None = None
        self.malformed = 0

    def take(self, datagram: bytes, now_ns: int) -> None:
        """Take up the datagram of a tick."""
        try:
            found = {number: bytes(body) for number, body in entries(datagram)}
            self._check(found)
        except (struct.error, KeyError, ValueError):
            self.malformed += 1
            return
        number = next(iter(found))
        tick = self._ticks[number]
        tick.load(found.pop(number))
        assert isinstance(tick, Tick)
        self.loops[self._names[number]].take(tick)
        self.last_ns = now_ns
        for number, body in found.items():
            self._bodies[self._channels[number].record.topic] = body
            if self._channels[number].record.topic == topics.IMU:
                self._take_imu(body, tick.now_ns)

    def _take_imu(self, body: bytes, used_ns: int) -> None:
        imu = self._records[topics.IMU]
        imu.load(body)
        assert isinstance(imu, Imu)
        self.imu_age_ns.append(used_ns - imu.stamp_ns)
        before, self._imu_sequence = self._imu_sequence, imu.sequence
        if before:
            self.imu_passed_over += max(imu.sequence - before - 1, 0)

    def _check(self, found: Mapping[int, bytes]) -> None:
        """See that a tick comes first, and that all lengths are right."""
        if next(iter(found), None) not in self._ticks:
            raise ValueError("no tick")
        for number, body in found.items():
            if len(body) != self._channels[number].record.cdr_size:
                raise ValueError("another length")

    def knows(self, topic: str) -> bool:
        """Whether the loops have such a signal."""
        return topic in self._records

    def newest(self, topic: str, kind: type[AnyRecord]) -> AnyRecord | None:
        """The newest record of a topic, None before the first; it is overwritten by the next call."""
        body = self._bodies.get(topic)
        if body is None:
            return None
        record = self._records[topic]
        record.load(body)
        assert isinstance(record, kind)
        return record

    def silent(self, now_ns: int, silent_ns: int) -> bool:
        """Whether no tick came for so long."""
        return self.last_ns is None or now_ns - self.last_ns > silent_ns
