# SPDX-License-Identifier: Apache-2.0
"""CAN buses in memory, in virtual time: encoded frames only, each delivered after its transmission time.

Each bus carries one frame at a time at its bit rate. Of the frames that wait when the bus falls free the one of highest
priority goes first. A frame occupies its bus for the longest time that its length allows (every possible stuff bit, and
the interframe space), so that arrival times do not depend on the data and are never too early.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import lru_cache
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drivers.can_frame import (
    CAN_EFF_FLAG,
    CAN_FRAME,
    CAN_RTR_FLAG,
    FRAME_SIZE,
    Frames,
    arbitration_priority,
    max_frame_bits,
)
from drivers.errors import DriverConfigError, FrameError

QUEUE_CAPACITY = 128
"""Frames that one end may have waiting on one bus: the transmit queue length set on the robot."""


NS_PER_SECOND = 1_000_000_000


class End(IntEnum):
    """The two ends of every bus."""

    HOST = 0
    DEVICE = 1


Tamper = Callable[[End, int, int, bytes], "bytes | None"]
"""Called with (sender, bus, arrival_ns, frame); returns the 16 bytes to deliver, or None to destroy the frame."""


class Received(NamedTuple):
    """Frames in order of arrival.

    Attributes:
        frames: (n,) of dtype `CAN_FRAME`.
        bus: (n,) bus index of each.
        arrival_ns: (n,) when each was complete.
    """

    frames: Frames
    bus: npt.NDArray[np.uint8]
    arrival_ns: npt.NDArray[np.int64]


_NOTHING = Received(np.zeros(0, CAN_FRAME), np.zeros(0, np.uint8), np.zeros(0, np.int64))


_Waiting = tuple[int, int, int, End, bytes, int]
"""A frame before its transmission: priority, order of sending, duration, sender, bytes, time from which it contends."""

_READY = itemgetter(5)


class _Wire:
    """One bus: who waits, how many of each end, and when the bus falls free."""

    __slots__ = ("free_ns", "queued", "waiting")

    def __init__(self) -> None:
        self.free_ns = 0
        self.waiting: list[_Waiting] = []
        self.queued = [0, 0]


class MemoryBus:
    """Buses between a controller (`End.HOST`) and the drives (`End.DEVICE`).

    Frames sent for a time that a bus has already passed wait until it falls free: what was carried is not taken back.

    Args:
        buses: how many.
        bit_rate: bit/s, of each.
        queue_capacity: frames that each end may have waiting on each bus; further ones are lost and counted.
        receive_capacity: frames that may wait to be received at each end; further ones are lost and counted.
        tamper: alters or destroys frames on their way, for tests and fault injection.
    """

    def __init__(
        self,
        buses: int,
        bit_rate: int = 1_000_000,
        queue_capacity: int = QUEUE_CAPACITY,
        receive_capacity: int = 1024,
        tamper: Tamper | None = None,
    ) -> None:
        if not 1 <= buses <= 256 or bit_rate <= 0:
            raise DriverConfigError(f"{buses} buses at {bit_rate} bit/s: there must be 1 to 256 at a positive rate")
        self.tamper = tamper
        self._queue_capacity, self._receive_capacity = queue_capacity, receive_capacity
        self._wires = [_Wire() for _ in range(buses)]
        self._arrived: tuple[list[tuple[int, int, int, bytes]], ...] = ([], [])
        self._lost = [0, 0]
        self._sequence = 0
        self._airtime = _airtimes(bit_rate)

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]) -> None:
        """Queue frames.

        Args:
            end: the sender.
            bus: (n,) bus index of each frame.
            frames: (n,) of dtype `CAN_FRAME`.
            at_ns: when they are handed to the bus; one time, or one for each.

        Raises:
            FrameError: if a bus does not exist.
        """
        raw, sequence = frames.tobytes(), self._sequence
        times = [at_ns] * len(frames) if isinstance(at_ns, int) else at_ns.tolist()
        begin = 0
        for index, can_id, length, ready_ns in zip(
            bus.tolist(), frames["can_id"].tolist(), frames["length"].tolist(), times, strict=True
        ):
            if index >= len(self._wires):
                raise FrameError(f"there is no bus {index}: {len(self._wires)} buses are configured")
            wire, frame = self._wires[index], raw[begin : begin + FRAME_SIZE]
            begin += FRAME_SIZE
            if wire.queued[end] >= self._queue_capacity:
                self._lost[end] += 1
                continue
            wire.queued[end] += 1
            sequence += 1
            priority, duration_ns = self._airtime(can_id, length)
            wire.waiting.append((priority, sequence, duration_ns, end, frame, ready_ns))
        self._sequence = sequence

    def receive(self, end: End, until_ns: int, limit: int | None = None) -> Received:
        """Let the buses work until `until_ns` and take what has arrived at an end by then.

        Args:
            end: the receiver.
            until_ns: ns.
            limit: at most so many frames, the oldest; the rest stays.
        """
        for index, wire in enumerate(self._wires):
            if wire.waiting:
                self._carry(index, wire, until_ns)
        arrived = self._arrived[end]
        if not arrived:
            return _NOTHING
        arrived.sort()
        count = len(arrived)
        while count and arrived[count - 1][0] > until_ns:
            count -= 1
        if limit is not None:
            count = min(count, limit)
        taken = arrived[:count]
        del arrived[:count]
        if not taken:
            return _NOTHING
        times, buses, _, frames = zip(*taken, strict=True)
        return Received(
            np.frombuffer(b"".join(frames), CAN_FRAME), np.array(buses, np.uint8), np.array(times, np.int64)
        )

    def lost(self, end: End) -> int:
        """Frames lost since start for lack of room in this end's queues."""
        return self._lost[end]

    def _carry(self, index: int, wire: _Wire, until_ns: int) -> None:
        """Complete every transmission that ends by `until_ns`."""
        waiting, taken = wire.waiting, 0
        contending: list[_Waiting] = []
        waiting.sort(key=_READY)
        free_ns = wire.free_ns
        while contending or taken < len(waiting):
            start_ns = free_ns if contending else max(free_ns, waiting[taken][5])
            if taken < len(waiting) and waiting[taken][5] <= start_ns:
                while taken < len(waiting) and waiting[taken][5] <= start_ns:
                    contending.append(waiting[taken])
                    taken += 1
                contending.sort(reverse=True)
            _, sequence, duration_ns, sender, frame, _ = contending[-1]
            if start_ns + duration_ns > until_ns:
                break
            free_ns = start_ns + duration_ns
            contending.pop()
            wire.queued[sender] -= 1
            self._deliver(sender, index, free_ns, sequence, frame)
        wire.free_ns = free_ns
        wire.waiting = contending + waiting[taken:]

    def _deliver(self, sender: End, index: int, arrival_ns: int, sequence: int, frame: bytes) -> None:
        if self.tamper is not None:
            changed = self.tamper(sender, index, arrival_ns, frame)
            if changed is None:
                return
            if len(changed) != FRAME_SIZE:
                raise FrameError(f"tampering gave {len(changed)} bytes instead of {FRAME_SIZE}")
            frame = changed
        receiver = 1 - sender
        if len(self._arrived[receiver]) < self._receive_capacity:
            self._arrived[receiver].append((arrival_ns, index, sequence, frame))
        else:
            self._lost[receiver] += 1


def _airtimes(bit_rate: int) -> Callable[[int, int], tuple[int, int]]:
    """A remembered function from (can_id, length) to (priority, ns on the bus)."""

    @lru_cache(maxsize=4096)
    def airtime(can_id: int, length: int) -> tuple[int, int]:
        bits = max_frame_bits(0 if can_id & CAN_RTR_FLAG else length, bool(can_id & CAN_EFF_FLAG))
        return arbitration_priority(can_id), -(-bits * NS_PER_SECOND // bit_rate)

    return airtime
