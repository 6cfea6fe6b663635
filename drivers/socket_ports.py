# SPDX-License-Identifier: Apache-2.0
"""The controller's end of real buses, as the ports of a loop.

The loop owns the buses and polls them: what waits when it reads is read, within its share of the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

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
        frames = b""
        buses: list[int] = []
        arrival_ns: list[int] = []
        for index, bus in enumerate(self._buses):
            arrived, times = bus.receive(share, now_ns)
            frames += arrived
            arrival_ns += times
            buses += [index] * len(times)
        heed_errors(frames, buses, self._health)
        return fill(record, now_ns, frames, buses, arrival_ns, sum(health.overflow for health in self._health))


class SocketWriter:
    """Sends the frames of a batch.

    Args:
        buses: as `open_buses` gives them.
    """

    def __init__(self, buses: Sequence[BusSocket]) -> None:
        self._buses = tuple(buses)
        self._order, self._runs = b"", list[tuple[int, int, int]]()

    def write(self, record: FrameBatch, now_ns: int) -> None:
        """Send the `count` frames of the batch; what a bus does not take is lost and counted.

        Frames of one bus that follow each other are sent by one call.

        Raises:
            FrameError: if the count exceeds the capacity, or a frame is for a bus that there is none of.
        """
        bus, data = content(record)
        self._plan(bus)
        frames = data.tobytes()
        for index, begin, end in self._runs:
            self._buses[index].send(frames[begin:end], now_ns)

    def withhold(self, record: FrameBatch) -> None:
        """Count the frames of a batch that is not sent.

        Raises:
            FrameError: as `write`.
        """
        bus, _ = content(record)
        self._plan(bus)
        for index, begin, end in self._runs:
            self._buses[index].health.withheld += (end - begin) // FRAME_SIZE

    def _plan(self, bus: npt.NDArray[np.uint8]) -> None:
        """Note which bytes of a batch whose frames are for these buses go to which bus by one call."""
        if bus.tobytes() == self._order:
            return
        if bus.size and bus.max() >= len(self._buses):
            raise FrameError(f"there is no bus {bus.max()}: {len(self._buses)} buses are open")
        edges = [0, *(np.flatnonzero(np.diff(bus)) + 1).tolist(), len(bus)]
        self._runs = [(int(bus[begin]), begin * FRAME_SIZE, end * FRAME_SIZE) for begin, end in pairwise(edges) if end]
        self._order = bus.tobytes()
