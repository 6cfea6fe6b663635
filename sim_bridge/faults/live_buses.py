# SPDX-License-Identifier: Apache-2.0
"""Buses in real time that can be broken: hubs whose frames are changed or destroyed, and whose links are lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drivers.can_frame import FRAME_SIZE, Frames
from drivers.device_end import DeviceEnd
from drivers.memory_bus import End, Received, Tamper
from drivers.unix_hub import UnixHub


class LiveBuses(DeviceEnd):
    """The drives' end of hubs, which an injector can tamper with as with a `MemoryBus`.

    Args:
        channels: paths of the hubs' socket files.

    Attributes:
        tamper: alters or destroys frames on their way; None leaves them alone.
        heard: told what arrives at the drives.
        now_ns: world time of the last step.

    Raises:
        DriverConfigError: if a hub cannot be made.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        self.tamper: Tamper | None = None
        self.heard: Callable[[Received], None] = _unheard
        self.now_ns = 0
        self._links = [_Link(self, bus, Path(channel)) for bus, channel in enumerate(channels)]
        super().__init__(self._links)

    def receive(self, end: End, until_ns: int) -> Received:
        """Take what has arrived at the drives; each frame is stamped `until_ns`."""
        self.now_ns = until_ns
        received = super().receive(end, until_ns)
        self.heard(received)
        return received

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]) -> None:
        """Send frames (n,) on the buses (n,), now; those that the host had waiting are its own affair."""
        if end == End.DEVICE:
            super().send(end, bus, frames, at_ns)

    def take_down(self, bus: int) -> None:
        """Let a link be lost: its hub goes, and who uses it is told so."""
        self._links[bus].close()

    def bring_up(self, bus: int) -> None:
        """Let a link return."""
        self._links[bus].open()


def _unheard(received: Received) -> None:
    """Nobody listens."""


class _Link:
    """One hub, or the place of one that is down."""

    def __init__(self, buses: LiveBuses, bus: int, path: Path) -> None:
        self._buses, self._bus, self._path = buses, bus, path
        self._hub: UnixHub | None = None
        self.open()

    def open(self) -> None:
        if self._hub is None:
            self._hub = UnixHub(self._path)

    def close(self) -> None:
        if self._hub is not None:
            self._hub.close()
            self._hub = None

    def send(self, frames: bytes) -> None:
        if self._hub is not None:
            self._hub.send(self._tampered(End.DEVICE, frames))

    def receive(self) -> bytes:
        return b"" if self._hub is None else self._tampered(End.HOST, self._hub.receive())

    def _tampered(self, sender: End, frames: bytes) -> bytes:
        tamper = self._buses.tamper
        if tamper is None:
            return frames
        places = range(0, len(frames), FRAME_SIZE)
        changed = (tamper(sender, self._bus, self._buses.now_ns, frames[at : at + FRAME_SIZE]) for at in places)
        return b"".join(frame for frame in changed if frame is not None)
