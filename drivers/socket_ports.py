# SPDX-License-Identifier: Apache-2.0
"""The controller's end of real buses, as the ports of a loop.

The loop owns the buses and polls them: what waits when it reads is read, within its share of the room.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.bus_health import heed_errors
from drivers.bus_socket import BusSocket
from drivers.can_frame import FRAME_SIZE
from drivers.errors import FrameError
from drivers.frame_batch import FrameBatch, content, fill


class SocketReader:
    """Fills a batch with the frames that wait on the buses.

    Args:
        buses: as `open_buses` gives them.
    """

    def __init__(self, buses: Sequence[BusSocket]) -> None:
        self._buses = tuple(buses)
        self._health = [bus.health for bus in buses]

    def read(self, record: FrameBatch, now_ns: int) -> bool:
        """Replace the content of the batch by what has arrived; what does not fit waits for the next read.

        Each bus in turn gives its frames, in order, error frames too. Each has the same share of the room, so that a
        flooded one neither displaces the others nor keeps the loop busy; the flood is its health's backlog.

        Returns:
            Whether the batch changed; it stays as it is if nothing arrived and it was empty.
        """
        share = len(record.bus) // len(self._buses)
        frames: list[bytes] = []
        buses: list[int] = []
        arrival_ns: list[int] = []
        for index, bus in enumerate(self._buses):
            arrived, times = bus.receive(share, now_ns)
            frames += arrived
            arrival_ns += times
            buses += [index] * len(arrived)
        raw = b"".join(frames)
        heed_errors(raw, buses, self._health)
        return fill(record, now_ns, raw, buses, arrival_ns, sum(health.overflow for health in self._health))


class SocketWriter:
    """Sends the frames of a batch.

    Args:
        buses: as `open_buses` gives them.
    """

    def __init__(self, buses: Sequence[BusSocket]) -> None:
        self._buses = tuple(buses)

    def write(self, record: FrameBatch, now_ns: int) -> None:
        """Send the `count` frames of the batch; what a bus does not take is lost and counted.

        Raises:
            FrameError: if the count exceeds the capacity, or a frame is for a bus that there is none of.
        """
        bus, data = content(record)
        raw = data.tobytes()
        for row, index in enumerate(self._checked(bus)):
            self._buses[index].send(raw[row * FRAME_SIZE : row * FRAME_SIZE + FRAME_SIZE], now_ns)

    def _checked(self, bus: npt.NDArray[np.uint8]) -> list[int]:
        buses: list[int] = bus.tolist()
        if buses and max(buses) >= len(self._buses):
            raise FrameError(f"there is no bus {max(buses)}: {len(self._buses)} buses are open")
        return buses
