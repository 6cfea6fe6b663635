# SPDX-License-Identifier: Apache-2.0
"""The controller's end of in-memory buses, as the ports of a loop."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from drivers.can_frame import FRAME_SIZE, Frames, as_frames
from drivers.errors import FrameError
from drivers.memory_bus import End, MemoryBus


class FrameBatch(Protocol):
    """A batch of frames of fixed capacity.

    Attributes:
        stamp_ns: when the batch was read or written.
        count: frames in it.
        lost: frames lost since start for lack of room.
        bus: (capacity,) bus index of each frame.
        arrival_ns: (capacity,) when each was received.
        data: (16 * capacity,) bytes of the frames.
    """

    stamp_ns: int
    count: int
    lost: int
    bus: npt.NDArray[np.uint8]
    arrival_ns: npt.NDArray[np.int64]
    data: npt.NDArray[np.uint8]


class MemoryReader:
    """Fills a batch with the frames that reached the controller."""

    def __init__(self, bus: MemoryBus) -> None:
        self._bus = bus

    def read(self, record: FrameBatch, now_ns: int) -> bool:
        """Replace the content of the batch by what arrived up to `now_ns`; what does not fit waits for the next read.

        Returns:
            Whether the batch changed; it stays as it is if nothing arrived and it was empty.
        """
        frames, bus, arrival_ns = self._bus.receive(End.HOST, now_ns, len(record.bus))
        count, before = len(bus), record.count
        if not count and not before:
            return False
        record.stamp_ns, record.count, record.lost = now_ns, count, self._bus.lost(End.HOST)
        record.bus[:count] = bus
        record.arrival_ns[:count] = arrival_ns
        memoryview(record.data)[: count * FRAME_SIZE] = frames.tobytes()  # type: ignore[arg-type]
        if count < before:
            record.bus[count:before] = 0
            record.arrival_ns[count:before] = 0
            record.data[count * FRAME_SIZE : before * FRAME_SIZE] = 0
        return True


class MemoryWriter:
    """Sends the frames of a batch from the controller."""

    def __init__(self, bus: MemoryBus) -> None:
        self._bus = bus

    def write(self, record: FrameBatch, now_ns: int) -> None:
        """Queue the `count` frames of the batch at `now_ns`.

        Raises:
            FrameError: if the count exceeds the capacity.
        """
        count = record.count
        if count > len(record.bus):
            raise FrameError(f"a batch for {len(record.bus)} frames claims to hold {count}")
        if count:
            frames: Frames = as_frames(record.data[: count * FRAME_SIZE])
            self._bus.send(End.HOST, record.bus[:count], frames, now_ns)
