# SPDX-License-Identifier: Apache-2.0
"""The drives' end of real buses: what a simulator in real time has in the place of the `MemoryBus` of virtual time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import can
import numpy as np
import numpy.typing as npt

from drivers.can_frame import CAN_FRAME, FRAME_SIZE, Frames
from drivers.errors import DriverConfigError
from drivers.memory_bus import End, Received
from drivers.opening import UNIX, open_bus
from drivers.unix_hub import UnixHub

_MOST_FRAMES = 256
"""Taken from one bus at once, so that a flood does not hold the simulator up."""


class Wires(Protocol):
    """Buses as the world at their far end uses them; a `MemoryBus` is such, and so is a `DeviceEnd`."""

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]) -> None:
        """Give frames (n,) to the buses (n,)."""

    def receive(self, end: End, until_ns: int) -> Received:
        """Take what has arrived."""


class Wire(Protocol):
    """One bus; a `UnixHub` is such."""

    def send(self, frames: bytes) -> None:
        """Send frames of 16 bytes each."""

    def receive(self) -> bytes:
        """All that has arrived, 16 bytes a frame."""

    def close(self) -> None:
        """Leave the bus."""


class CanWire:
    """A bus of the kernel, for the drives' end.

    Args:
        bus: of python-can, opened; it is closed with this.

    Attributes:
        dropped: frames that the bus did not take.
        rejected: packets that were not one frame.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self._bus, self._descriptor = bus, bus.fileno()
        os.set_blocking(self._descriptor, False)
        self.dropped = self.rejected = 0

    def send(self, frames: bytes) -> None:
        """Send frames of 16 bytes each; what the bus does not take is lost and counted."""
        for begin in range(0, len(frames), FRAME_SIZE):
            try:
                os.write(self._descriptor, frames[begin : begin + FRAME_SIZE])
            except OSError:
                self.dropped += 1

    def receive(self) -> bytes:
        """What has arrived, 16 bytes a frame; a bus that is down gives nothing."""
        frames = []
        for _ in range(_MOST_FRAMES):
            try:
                packet = os.read(self._descriptor, 2 * FRAME_SIZE)
            except OSError:
                break
            if len(packet) == FRAME_SIZE:
                frames.append(packet)
            else:
                self.rejected += 1
        return b"".join(frames)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


class DeviceEnd:
    """The far ends of several buses, with the interface of a `MemoryBus`.

    Replies leave at once, and a frame has arrived when it is taken: time on the wire is the wire's own.

    Args:
        wires: one a bus; they are closed with this.
    """

    def __init__(self, wires: Sequence[Wire]) -> None:
        self._wires = tuple(wires)

    def receive(self, end: End, until_ns: int) -> Received:
        """Take what has arrived at the drives; each frame is stamped `until_ns`."""
        arrived = [wire.receive() for wire in self._wires]
        counts = [len(frames) // FRAME_SIZE for frames in arrived]
        bus = np.repeat(np.arange(len(arrived), dtype=np.uint8), counts)
        return Received(np.frombuffer(b"".join(arrived), CAN_FRAME), bus, np.full(len(bus), until_ns, np.int64))

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]) -> None:
        """Send frames (n,) of the drives on the buses (n,), now, whatever `at_ns` says."""
        for index, wire in enumerate(self._wires):
            wire.send(frames[bus == index].tobytes())

    def close(self) -> None:
        """Leave the buses, the last one first."""
        for wire in reversed(self._wires):
            wire.close()


def open_device_end(interface: str, channels: Sequence[str]) -> DeviceEnd:
    """The drives' end of the buses that a configuration names: for hubs the hubs themselves, else one more socket.

    Raises:
        DriverConfigError: if one cannot be made or opened; then none is.
    """
    wires: list[Wire] = []
    try:
        for channel in channels:
            wires.append(UnixHub(Path(channel)) if interface == UNIX else CanWire(open_bus(interface, channel)))
    except DriverConfigError:
        DeviceEnd(wires).close()
        raise
    return DeviceEnd(wires)
