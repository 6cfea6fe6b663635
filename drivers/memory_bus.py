# SPDX-License-Identifier: Apache-2.0
"""CAN buses in memory, in virtual time: encoded frames only, each delivered after its transmission time.

Each bus carries one frame at a time at its bit rate. Of the frames that wait when the bus falls free the one of highest
priority goes first. A frame occupies its bus for the longest time that its length allows (every possible stuff bit, and
the interframe space), so that arrival times do not depend on the data and are never too early.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drivers.bus_timing import Timetable
from drivers.can_frame import CAN_FRAME, FRAME_SIZE, Frames
from drivers.errors import DriverConfigError, FrameError
from drivers.patterns import heads

QUEUE_CAPACITY = 128
"""Frames that one end may have waiting on one bus: the transmit queue length set on the robot."""


class End(IntEnum):
    """The two ends of every bus."""

    HOST = 0
    DEVICE = 1


Tamper = Callable[[End, int, int, bytes], "bytes | None"]
"""Called with (sender, bus, arrival_ns, frame) when a frame is received; returns the 16 bytes to deliver, or None to
destroy the frame."""


class Received(NamedTuple):
    """Frames in order of arrival.

    Attributes:
        frames: (n,) of dtype `CAN_FRAME`; read only.
        bus: (n,) bus index of each; read only.
        arrival_ns: (n,) when each was complete.
    """

    frames: Frames
    bus: npt.NDArray[np.uint8]
    arrival_ns: npt.NDArray[np.int64]


_NOTHING = Received(np.zeros(0, CAN_FRAME), np.zeros(0, np.uint8), np.zeros(0, np.int64))


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
        self._timetable = Timetable(buses, bit_rate, queue_capacity, receive_capacity)
        self._situation, self._reference_ns = self._timetable.start, 0
        self._held = b""
        self._lost = [0, 0]

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]) -> None:
        """Queue frames.

        Args:
            end: the sender.
            bus: (n,) bus index of each frame.
            frames: (n,) of dtype `CAN_FRAME`.
            at_ns: when they are handed to the bus; one time, or one for each.

        Raises:
            FrameError: if a bus does not exist; then none of them is queued.
        """
        raw, ready = frames.tobytes(), at_ns - self._reference_ns
        times = ready if isinstance(ready, int) else ready.tobytes()
        self._situation, accepted, lost = self._timetable.send(
            self._situation, int(end), heads(raw), bus.tobytes(), times
        )
        self._lost[end] += lost
        self._held += raw if accepted is None else b"".join([raw[rows] for rows in accepted])

    def receive(self, end: End, until_ns: int, limit: int | None = None) -> Received:
        """Let the buses work until `until_ns` and take what has arrived at an end by then.

        Args:
            end: the receiver.
            until_ns: ns.
            limit: at most so many frames, the oldest; the rest stays.
        """
        if self._situation.idle:
            return _NOTHING
        held = self._held
        before_ns, self._reference_ns = self._reference_ns, until_ns
        self._situation, taken, bus, arrival_ns, kept, lost = self._timetable.receive(
            self._situation, int(end), until_ns - before_ns, limit
        )
        self._held = b"".join([held[rows] for rows in kept])
        self._lost[0] += lost[0]
        self._lost[1] += lost[1]
        raw = b"".join([held[rows] for rows in taken])
        received = Received(np.frombuffer(raw, CAN_FRAME), bus, arrival_ns + before_ns)
        return received if self.tamper is None else self._tampered(End(1 - end), received, self.tamper)

    def lost(self, end: End) -> int:
        """Frames lost since start for lack of room in this end's queues."""
        return self._lost[end]

    @staticmethod
    def _tampered(sender: End, received: Received, tamper: Tamper) -> Received:
        delivered, rows = [], []
        for row, (frame, bus, arrival_ns) in enumerate(zip(*received, strict=True)):
            changed = tamper(sender, int(bus), int(arrival_ns), frame.tobytes())
            if changed is None:
                continue
            if len(changed) != FRAME_SIZE:
                raise FrameError(f"tampering gave {len(changed)} bytes instead of {FRAME_SIZE}")
            delivered.append(changed)
            rows.append(row)
        return Received(np.frombuffer(b"".join(delivered), CAN_FRAME), received.bus[rows], received.arrival_ns[rows])
