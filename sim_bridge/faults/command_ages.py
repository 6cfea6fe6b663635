# SPDX-License-Identifier: Apache-2.0
"""How old commands are when they reach the drives: seen at both ends of the buses, whatever lies between."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.can_frame import FRAME_SIZE
from drivers.memory_bus import End, MemoryBus, Received
from runtime.executors.loop_run import OutputPort


class CommandAges:
    """Knows a frame by its bus and bytes; of several alike the newest counts, since they ask for the same.

    Args:
        bus: whose far end is looked at from now on.
        ahead_ns: by how much the clock of the buses is ahead of that which stamps the commands.

    Attributes:
        oldest_ns: age of the oldest command at its arrival.
    """

    def __init__(self, bus: MemoryBus, ahead_ns: Callable[[], int] = lambda: 0) -> None:
        self.oldest_ns, self._ahead_ns = 0, ahead_ns
        self._stamps: dict[tuple[int, bytes], int] = {}
        self._receive = bus.receive
        bus.receive = self._received  # type: ignore[method-assign]

    def noted(self, port: OutputPort) -> OutputPort:
        """The port, whose commands are noted before it sees them."""
        return _Noted(port, self._stamps, self._ahead_ns)

    def _received(self, end: End, until_ns: int, limit: int | None = None) -> Received:
        received = self._receive(end, until_ns, limit)
        if end == End.DEVICE:
            for frame, bus, arrival_ns in zip(*received, strict=True):
                stamp_ns = self._stamps.get((int(bus), frame.tobytes()), arrival_ns)
                self.oldest_ns = max(self.oldest_ns, int(arrival_ns - stamp_ns))
        return received


class _Noted:
    def __init__(self, port: OutputPort, stamps: dict[tuple[int, bytes], int], ahead_ns: Callable[[], int]) -> None:
        self._port, self._stamps, self._ahead_ns = port, stamps, ahead_ns

    def write(self, record: Any, now_ns: int) -> None:
        data, stamp_ns = record.data.tobytes(), int(record.stamp_ns) + self._ahead_ns()
        for place, bus in enumerate(record.bus[: record.count].tolist()):
            self._stamps[bus, data[FRAME_SIZE * place : FRAME_SIZE * (place + 1)]] = stamp_ns
        self._port.write(record, now_ns)
