# SPDX-License-Identifier: Apache-2.0
"""The controller's end of real buses, as the ports of a loop: one socket a bus, one frame a packet, never waiting.

python-can opens and configures a bus; these ports then read and write its descriptor, which takes a tenth of the time
per frame. It is the same for SocketCAN and for a `UnixHub`.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Sequence
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from drivers.can_frame import FRAME_SIZE
from drivers.errors import FrameError
from drivers.memory_ports import FrameBatch

SEND_BUFFER_BYTES = 4096
"""Room for a few frames: what a bus cannot carry now is refused, not kept to fire when power returns."""


class BusCounter(IntEnum):
    """Meaning of each row of the ports' `counters`."""

    REFUSED = 0
    FAILED = 1
    NO_FRAME = 2


_NO_ROOM = (errno.EAGAIN, errno.ENOBUFS)


def open_ends(descriptors: Sequence[int]) -> tuple[int, ...]:
    """Make the descriptors of opened buses fit for the ports: they do not wait, and queue little.

    They stay python-can's, which closes them.
    """
    for descriptor in descriptors:
        os.set_blocking(descriptor, False)
        with socket.socket(fileno=os.dup(descriptor)) as end:
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
    return tuple(descriptors)


class SocketReader:
    """Fills a batch with the frames that wait on the buses.

    Args:
        ends: of the buses, as `open_ends` gives them.

    Attributes:
        counters: (len(BusCounter), buses) since start: reads that failed, as the bus is down, and packets that were no
            frame.
    """

    def __init__(self, ends: Sequence[int]) -> None:
        self._ends = tuple(ends)
        self.counters = np.zeros((len(BusCounter), len(self._ends)), np.uint32)

    def read(self, record: FrameBatch, now_ns: int) -> bool:
        """Replace the content of the batch by what has arrived; what does not fit waits for the next read.

        Each bus in turn gives its frames, in order; a flooded one leaves the others their share of the room.

        Returns:
            Whether the batch changed; it stays as it is if nothing arrived and it was empty.
        """
        share = len(record.bus) // len(self._ends)
        frames: list[bytes] = []
        buses: list[int] = []
        for bus, end in enumerate(self._ends):
            arrived = self._frames(bus, end, share)
            frames += arrived
            buses += [bus] * len(arrived)
        count, before = len(buses), record.count
        if not count and not before:
            return False
        record.stamp_ns, record.count = now_ns, count
        record.bus[:count], record.arrival_ns[:count] = buses, now_ns
        record.data[: count * FRAME_SIZE] = np.frombuffer(b"".join(frames), np.uint8)
        if count < before:
            record.bus[count:before] = 0
            record.arrival_ns[count:before] = 0
            record.data[count * FRAME_SIZE : before * FRAME_SIZE] = 0
        return True

    def _frames(self, bus: int, end: int, most: int) -> list[bytes]:
        frames: list[bytes] = []
        while len(frames) < most:
            try:
                packet = os.read(end, 2 * FRAME_SIZE)
            except BlockingIOError:
                break
            except OSError:
                packet = b""
            if not packet:
                self.counters[BusCounter.FAILED, bus] += 1
                break
            if len(packet) == FRAME_SIZE:
                frames.append(packet)
            else:
                self.counters[BusCounter.NO_FRAME, bus] += 1
        return frames


class SocketWriter:
    """Sends the frames of a batch.

    Args:
        ends: of the buses, as `open_ends` gives them.

    Attributes:
        counters: (len(BusCounter), buses) since start: frames refused for lack of room, and those that failed as the
            bus is down.
    """

    def __init__(self, ends: Sequence[int]) -> None:
        self._ends = tuple(ends)
        self.counters = np.zeros((len(BusCounter), len(self._ends)), np.uint32)

    def write(self, record: FrameBatch, now_ns: int) -> None:
        """Send the `count` frames of the batch; what a bus does not take is lost and counted.

        Raises:
            FrameError: if the count exceeds the capacity, or a frame is for a bus that there is none of.
        """
        count = record.count
        if count > len(record.bus):
            raise FrameError(f"a batch for {len(record.bus)} frames claims to hold {count}")
        raw = record.data[: count * FRAME_SIZE].tobytes()
        for row, bus in enumerate(self._checked(record.bus[:count])):
            try:
                os.write(self._ends[bus], raw[row * FRAME_SIZE : row * FRAME_SIZE + FRAME_SIZE])
            except OSError as error:
                kind = BusCounter.REFUSED if error.errno in _NO_ROOM else BusCounter.FAILED
                self.counters[kind, bus] += 1

    def _checked(self, bus: npt.NDArray[np.uint8]) -> list[int]:
        buses = bus.tolist()
        if buses and max(buses) >= len(self._ends):
            raise FrameError(f"there is no bus {max(buses)}: {len(self._ends)} buses are open")
        return buses
