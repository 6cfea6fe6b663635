# SPDX-License-Identifier: Apache-2.0
"""The buses as a computer sees them whose clock has stood still for a while: the world is ahead of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from drivers.can_frame import Frames
from drivers.memory_bus import End, MemoryBus, Received
from sim_bridge.faults.virtual_clocks import VirtualClocks


class AheadBus:
    """The near end of a `MemoryBus`, in monotonic time.

    Args:
        bus: in the time of the world.
        clocks: of the computer.

    Attributes:
        health: as of the bus.
    """

    def __init__(self, bus: MemoryBus, clocks: VirtualClocks) -> None:
        self._bus, self._clocks = bus, clocks
        self.health = bus.health

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int) -> None:
        """Queue frames."""
        self._bus.send(end, bus, frames, at_ns + self._clocks.suspended_ns)

    def receive(self, end: End, until_ns: int, limit: int | None = None) -> Received:
        """Take what has arrived."""
        ahead_ns = self._clocks.suspended_ns
        received = self._bus.receive(end, until_ns + ahead_ns, limit)
        return received._replace(arrival_ns=received.arrival_ns - ahead_ns)

    def lost(self, end: End) -> int:
        """Frames lost for lack of room."""
        return self._bus.lost(end)

    def waiting(self, end: End) -> list[int]:
        """Bus of each frame that waits to be received."""
        return self._bus.waiting(end)
