# SPDX-License-Identifier: Apache-2.0
"""When each frame crosses its bus: arbitration and transmission times, apart from what the frames carry.

These times follow from identifiers, lengths and times of sending alone, and in a control loop they are the same every
period. So what is on the buses is held as a value (`Situation`, with times relative to a moving reference), and what
follows from it is worked out once and remembered.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drivers.can_frame import (
    CAN_EFF_FLAG,
    CAN_FRAME,
    CAN_RTR_FLAG,
    FRAME_SIZE,
    arbitration_priority,
    max_frame_bits,
)
from drivers.errors import FrameError

NS_PER_SECOND = 1_000_000_000
_REMEMBERED = 1024
_FORGOTTEN_NS = -NS_PER_SECOND
"""A bus that fell free longer ago counts as free since then, so that idle buses are soon all alike."""

Rows = tuple[slice, ...]
"""Which of the frames held on the buses (in the order in which they were sent), as slices of their bytes."""


class Waiting(NamedTuple):
    """A frame before its transmission; the smallest of those that contend goes first."""

    priority: int
    row: int
    duration_ns: int
    sender: int
    bus: int
    ready_ns: int


class Arrived(NamedTuple):
    """A frame that has crossed its bus and waits to be received."""

    arrival_ns: int
    bus: int
    row: int


class Situation:
    """What is on the buses at the reference time, to which all times here are relative.

    Attributes:
        free_ns: when each bus falls free.
        waiting: the frames that are not yet transmitted.
        arrived: the frames that have arrived at each end.
        idle: whether there are neither.
    """

    __slots__ = ("arrived", "free_ns", "idle", "waiting")

    def __init__(
        self,
        free_ns: tuple[int, ...],
        waiting: tuple[Waiting, ...],
        arrived: tuple[tuple[Arrived, ...], tuple[Arrived, ...]],
    ) -> None:
        self.free_ns, self.waiting, self.arrived = free_ns, waiting, arrived
        self.idle = not waiting and not any(arrived)


class Sending(NamedTuple):
    """What follows from sending a batch.

    Attributes:
        situation: after it.
        accepted: rows of the batch that found room, None for all.
        lost: bus of each frame that did not.
    """

    situation: Situation
    accepted: Rows | None
    lost: tuple[int, ...]


class Delivery(NamedTuple):
    """What follows from receiving.

    Attributes:
        situation: after it, relative to the time up to which was received.
        taken: rows that are received, in order of arrival.
        bus: of each.
        arrival_ns: of each, relative to the old reference.
        kept: rows that stay on the buses.
        lost: for each end, bus of each frame that it lost for lack of room.
    """

    situation: Situation
    taken: Rows
    bus: npt.NDArray[np.uint8]
    arrival_ns: npt.NDArray[np.int64]
    kept: Rows
    lost: tuple[tuple[int, ...], tuple[int, ...]]


class Timetable:
    """Works out, and remembers, what follows from sending and receiving.

    Args:
        buses: how many.
        bit_rate: bit/s, of each.
        queue_capacity: frames that each end may have waiting on each bus.
        receive_capacity: frames that may wait to be received at each end.

    Attributes:
        start: empty buses.
        send: (situation, end, heads, buses, ready) -> `Sending`; the heads as `patterns.heads` gives them, the bytes of
            the bus indices (uint8), one time for all or the bytes of the times (int64).
        receive: (situation, end, until, limit) -> `Delivery`; of each bus at most `limit` frames if it is not None.
    """

    def __init__(self, buses: int, bit_rate: int, queue_capacity: int, receive_capacity: int) -> None:
        self._bit_rate, self._queue_capacity, self._receive_capacity = bit_rate, queue_capacity, receive_capacity
        self._situation = lru_cache(_REMEMBERED)(Situation)
        self.send = lru_cache(_REMEMBERED)(self._send)
        self.receive = lru_cache(_REMEMBERED)(self._receive)
        self.start = self._situation((0,) * buses, (), ((), ()))

    def _send(self, before: Situation, end: int, heads: int, bus: bytes, ready_ns: int | bytes) -> Sending:
        times = [ready_ns] * len(bus) if isinstance(ready_ns, int) else np.frombuffer(ready_ns, np.int64).tolist()
        waiting = list(before.waiting)
        accepted: list[int] = []
        lost: list[int] = []
        row = len(waiting) + sum(map(len, before.arrived))
        frames = np.frombuffer(heads.to_bytes(FRAME_SIZE * len(bus), "little"), CAN_FRAME)
        fields = zip(bus, frames["can_id"].tolist(), frames["length"].tolist(), times, strict=True)
        for index, (wire, can_id, length, ready) in enumerate(fields):
            if wire >= len(before.free_ns):
                raise FrameError(f"there is no bus {wire}: {len(before.free_ns)} buses are configured")
            if sum(frame.sender == end and frame.bus == wire for frame in waiting) < self._queue_capacity:
                priority, duration_ns = self._airtime(can_id, length)
                waiting.append(Waiting(priority, row + len(accepted), duration_ns, end, wire, ready))
                accepted.append(index)
            else:
                lost.append(wire)
        after = self._situation(before.free_ns, tuple(waiting), before.arrived)
        return Sending(after, _rows(accepted) if lost else None, tuple(lost))

    def _airtime(self, can_id: int, length: int) -> tuple[int, int]:
        """Priority of a frame, and ns that it occupies the bus."""
        bits = max_frame_bits(0 if can_id & CAN_RTR_FLAG else length, bool(can_id & CAN_EFF_FLAG))
        return arbitration_priority(can_id), -(-bits * NS_PER_SECOND // self._bit_rate)

    def _receive(self, before: Situation, end: int, until_ns: int, limit: int | None) -> Delivery:
        free: list[int] = []
        waiting: list[Waiting] = []
        carried: list[tuple[Arrived, int]] = []
        for bus, free_ns in enumerate(before.free_ns):
            left = [frame for frame in before.waiting if frame.bus == bus]
            free_ns, done = _carry(left, free_ns, until_ns)
            free.append(max(free_ns - until_ns, _FORGOTTEN_NS))
            waiting += left
            carried += done
        queues = (list(before.arrived[0]), list(before.arrived[1]))
        lost: tuple[list[int], list[int]] = [], []
        for frame, receiver in sorted(carried):
            if len(queues[receiver]) < self._receive_capacity:
                queues[receiver].append(frame)
            else:
                lost[receiver].append(frame.bus)
        for queue in queues:
            queue.sort()
        taken = _oldest(queues[end], until_ns, limit)
        queues[end][:] = [frame for frame in queues[end] if frame not in taken]
        return self._delivery(free, waiting, queues, taken, until_ns, (tuple(lost[0]), tuple(lost[1])))

    def _delivery(
        self,
        free: Sequence[int],
        waiting: Sequence[Waiting],
        queues: tuple[list[Arrived], list[Arrived]],
        taken: Sequence[Arrived],
        until_ns: int,
        lost: tuple[tuple[int, ...], tuple[int, ...]],
    ) -> Delivery:
        kept = sorted([w.row for w in waiting] + [a.row for queue in queues for a in queue])
        row_of = {row: index for index, row in enumerate(kept)}
        after = self._situation(
            tuple(free),
            tuple(sorted(w._replace(row=row_of[w.row], ready_ns=w.ready_ns - until_ns) for w in waiting)),
            (_moved(queues[0], row_of, until_ns), _moved(queues[1], row_of, until_ns)),
        )
        buses = np.array([frame.bus for frame in taken], np.uint8)
        buses.flags.writeable = False
        arrival_ns = np.array([frame.arrival_ns for frame in taken], np.int64)
        return Delivery(after, _rows([frame.row for frame in taken]), buses, arrival_ns, _rows(kept), lost)


def _carry(waiting: list[Waiting], free_ns: int, until_ns: int) -> tuple[int, list[tuple[Arrived, int]]]:
    """Complete every transmission on one bus that ends by `until_ns`.

    Args:
        waiting: frames for this bus; those that are carried are removed.
        free_ns: when the bus falls free.
        until_ns: the same clock.

    Returns:
        When the bus falls free then, and what arrived at which end.
    """
    carried = []
    while waiting:
        start_ns = max(free_ns, min(frame.ready_ns for frame in waiting))
        first = min(frame for frame in waiting if frame.ready_ns <= start_ns)
        if start_ns + first.duration_ns > until_ns:
            break
        free_ns = start_ns + first.duration_ns
        waiting.remove(first)
        carried.append((Arrived(free_ns, first.bus, first.row), 1 - first.sender))
    return free_ns, carried


def _oldest(queue: Sequence[Arrived], until_ns: int, limit: int | None) -> list[Arrived]:
    """Of the frames, in order of arrival, those that have arrived: of each bus at most so many."""
    taken: list[Arrived] = []
    for frame in queue:
        if frame.arrival_ns <= until_ns and (limit is None or sum(one.bus == frame.bus for one in taken) < limit):
            taken.append(frame)
    return taken


def _rows(rows: Sequence[int]) -> Rows:
    """Rows that follow each other become one slice."""
    runs: list[list[int]] = []
    for row in rows:
        if runs and runs[-1][1] == row:
            runs[-1][1] = row + 1
        else:
            runs.append([row, row + 1])
    return tuple(slice(FRAME_SIZE * first, FRAME_SIZE * end) for first, end in runs)


def _moved(queue: Sequence[Arrived], row_of: dict[int, int], by_ns: int) -> tuple[Arrived, ...]:
    return tuple(Arrived(frame.arrival_ns - by_ns, frame.bus, row_of[frame.row]) for frame in queue)
