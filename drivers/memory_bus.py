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

from drivers.bus_health import BusHealth, BusState
from drivers.bus_timing import Timetable
from drivers.can_frame import CAN_FRAME, FRAME_SIZE, Frames
from drivers.errors import DriverConfigError, FrameError
from drivers.patterns import heads

QUEUE_CAPACITY = 128
"""Frames that one end may have waiting on one bus: the transmit queue length set on the robot."""

_MOST_BUSES = 256


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

    Attributes:
        tamper: as given.
        health: of each bus, as the host learns of it.
    """

    def __init__(
        self,
        buses: int,
        bit_rate: int = 1_000_000,
        queue_capacity: int = QUEUE_CAPACITY,
        receive_capacity: int = 1024,
        tamper: Tamper | None = None,
    ) -> None:
        if not 1 <= buses <= _MOST_BUSES or bit_rate <= 0:
            raise DriverConfigError(
                f"{buses} buses at {bit_rate} bit/s: there must be 1 to {_MOST_BUSES} at a positive rate"
            )
        self.tamper = tamper
        self._timetable = Timetable(buses, bit_rate, queue_capacity, receive_capacity)
        self._situation, self._reference_ns = self._timetable.start, 0
        self._held = b""
        self._lost = [0, 0]
        self.health = tuple(BusHealth() for _ in range(buses))
        self._down, self._any_down = np.zeros(_MOST_BUSES, np.bool_), False

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
        if self._any_down:
            bus, frames, at_ns = self._sent_on_live_links(end, bus, frames, at_ns)
        raw, ready = frames.tobytes(), at_ns - self._reference_ns
        times = ready if isinstance(ready, int) else ready.tobytes()
        self._situation, accepted, lost = self._timetable.send(
            self._situation, int(end), heads(raw), bus.tobytes(), times
        )
        if lost:
            self._lost[end] += len(lost)
            if end == End.HOST:
                for wire in lost:
                    self.health[wire].refused += 1
        self._held += raw if accepted is None else b"".join([raw[rows] for rows in accepted])

    def receive(self, end: End, until_ns: int, limit: int | None = None) -> Received:
        """Let the buses work until `until_ns` and take what has arrived at an end by then.

        Args:
            end: the receiver.
            until_ns: ns.
            limit: at most so many frames of each bus, the oldest; the rest stays.
        """
        if self._situation.idle:
            return _NOTHING
        held = self._held
        before_ns, self._reference_ns = self._reference_ns, until_ns
        self._situation, taken, bus, arrival_ns, kept, lost = self._timetable.receive(
            self._situation, int(end), until_ns - before_ns, limit
        )
        self._held = b"".join([held[rows] for rows in kept])
        if any(lost):
            self._overflow(*lost)
        raw = b"".join([held[rows] for rows in taken])
        received = Received(np.frombuffer(raw, CAN_FRAME), bus, arrival_ns + before_ns)
        if self._any_down:
            received = self._received_on_live_links(end, received)
        return received if self.tamper is None else self._tampered(End(1 - end), received, self.tamper)

    def lost(self, end: End) -> int:
        """Frames lost since start for lack of room in this end's queues."""
        return self._lost[end]

    def waiting(self, end: End) -> list[int]:
        """Bus of each frame that an end could have received by the time of the last `receive`, but for its limit."""
        return [frame.bus for frame in self._situation.arrived[end] if frame.arrival_ns <= 0]

    # -- links ----------------------------------------------------------------------------------------------------

    def take_down(self, bus: int) -> None:
        """Let a link be lost: until `bring_up` no frame enters the bus, and none that is under way leaves it."""
        self._down[bus] = self._any_down = True
        self.health[bus].state = BusState.DOWN

    def bring_up(self, bus: int) -> None:
        """Let a link return."""
        self._down[bus] = False
        self._any_down = bool(self._down.any())
        self.health[bus].state = BusState.UP

    def _sent_on_live_links(
        self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]
    ) -> tuple[npt.NDArray[np.uint8], Frames, int | npt.NDArray[np.int64]]:
        down = self._down[bus]
        if end == End.HOST:
            for wire in bus[down]:
                self.health[wire].failed += 1
        return bus[~down], frames[~down], at_ns if isinstance(at_ns, int) else at_ns[~down]

    def _received_on_live_links(self, end: End, received: Received) -> Received:
        down = self._down[received.bus]
        if end == End.HOST:
            for wire in received.bus[down]:
                self.health[wire].purged += 1
        return Received(received.frames[~down], received.bus[~down], received.arrival_ns[~down])

    def _overflow(self, at_host: tuple[int, ...], at_device: tuple[int, ...]) -> None:
        self._lost[End.HOST] += len(at_host)
        self._lost[End.DEVICE] += len(at_device)
        for wire in at_host:
            self.health[wire].overflow += 1

    # -- tampering ------------------------------------------------------------------------------------------------

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
