# SPDX-License-Identifier: Apache-2.0
"""The controller's end of in-memory buses, as the ports of a loop; `MemoryBus.health` is what its monitor reports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from drivers.bus_health import BusHealth, heed_errors
from drivers.can_frame import Frames, as_frames
from drivers.frame_batch import FrameBatch, content, fill
from drivers.memory_bus import End, Received


class Buses(Protocol):
    """Buses in virtual time, as of `MemoryBus`."""

    @property
    def health(self) -> Sequence[BusHealth]:
        """Of each bus."""

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int) -> None:
        """Queue frames."""

    def receive(self, end: End, until_ns: int, limit: int | None = None) -> Received:
        """Take what has arrived at an end."""

    def lost(self, end: End) -> int:
        """Frames lost for lack of room."""

    def waiting(self, end: End) -> list[int]:
        """Bus of each frame that waits to be received."""


class MemoryReader:
    """Fills a batch with the frames that reached the controller."""

    def __init__(self, bus: Buses) -> None:
        self._bus = bus
        self._any_backlog = False

    def read(self, record: FrameBatch, now_ns: int) -> bool:
        """Replace the content of the batch by what arrived up to `now_ns`; what does not fit waits for the next read.

        Each bus has the same share of the room, as `SocketReader` gives it; the flood of one is its health's backlog.

        Returns:
            Whether the batch changed; it stays as it is if nothing arrived and it was empty.
        """
        share = len(record.bus) // len(self._bus.health)
        frames, bus, arrival_ns = self._bus.receive(End.HOST, now_ns, share)
        raw = frames.tobytes()
        heed_errors(raw, bus, self._bus.health)
        if self._any_backlog or len(bus) >= share:
            self._note_backlog()
        return fill(record, now_ns, raw, bus, arrival_ns, self._bus.lost(End.HOST))

    def _note_backlog(self) -> None:
        waiting = self._bus.waiting(End.HOST)
        self._any_backlog = bool(waiting)
        for bus, health in enumerate(self._bus.health):
            health.backlog = bus in waiting


class MemoryWriter:
    """Sends the frames of a batch from the controller."""

    def __init__(self, bus: Buses) -> None:
        self._bus = bus

    def write(self, record: FrameBatch, now_ns: int) -> None:
        """Queue the frames of the batch at `now_ns`.

        Raises:
            FrameError: if the count exceeds the capacity.
        """
        bus, data = content(record)
        if bus.size:
            self._bus.send(End.HOST, bus, as_frames(data), now_ns)

    def withhold(self, record: FrameBatch) -> None:
        """Count the frames of a batch that is not sent."""
        bus, _ = content(record)
        for index in bus.tolist():
            self._bus.health[index].withheld += 1
