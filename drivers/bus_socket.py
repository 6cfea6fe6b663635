# SPDX-License-Identifier: Apache-2.0
"""One bus on a real socket that never waits and never raises, whatever happens to its link.

python-can opens and configures the bus; its descriptor is then read and written directly, which takes a tenth of the
time per frame. It is the same for SocketCAN and for a `UnixHub`.

A bus whose link is lost is down, and what is to be sent on it is lost and counted. It is opened anew as soon as its
link has returned, by a new socket in any case: the interface may have been deleted and made again, and what waits in
the old one is too old to be believed. Nothing is sent on a bus that is down or off, so that little waits in the kernel
when it comes back: setting a link down empties its queue, and while a live bus takes nothing (no drive acknowledges)
the small send buffer lets no more than eight or nine frames wait. Those cannot be recalled; they go out within two
milliseconds of the return, and what is sent next overrides them.

A frame carries the kernel's time of its reception, brought from the wall clock to the monotonic one. Reading it with
the frame (`recvmsg`) costs about a microsecond more than reading the frame alone.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
import time
from collections.abc import Sequence

import can

from drivers.bus_health import BusHealth, BusState
from drivers.can_frame import FRAME_SIZE
from drivers.errors import DriverConfigError
from drivers.opening import open_bus

SEND_BUFFER_BYTES = 4096
"""Room for a few frames: what a bus cannot carry now is refused, not kept to fire when power returns."""
RETRY_NS = 100_000_000
"""How often a bus that is down is looked for."""

_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40
"""Missing from Python's socket module; also the types of the ancillary data."""
_TIMESPEC = struct.Struct("@qq")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(4)
_PACKET_BYTES = 2 * FRAME_SIZE
_MOST_PURGED = 1024
_NO_ROOM = (errno.EAGAIN, errno.ENOBUFS)
_NS_PER_SECOND = 1_000_000_000


class BusSocket:
    """One bus.

    Args:
        interface: of python-can: socketcan, or ugv-unix.
        channel: name of the CAN interface, or path of the hub's socket.

    Attributes:
        health: of the bus.

    Raises:
        DriverConfigError: if the bus cannot be opened.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self._interface, self._channel = interface, channel
        self.health = BusHealth()
        self._retry_ns = self._emptied_ns = self._overflow_before = 0
        self._take(open_bus(interface, channel))

    def receive(self, most: int, now_ns: int) -> tuple[list[bytes], list[int]]:
        """Frames that wait, and when each arrived.

        Args:
            most: frames to take at most; if more wait the bus has a backlog.
            now_ns: the present, by the monotonic clock.
        """
        frames: list[bytes] = []
        arrival_ns: list[int] = []
        health, receive = self.health, self._socket.recvmsg
        health.backlog = False
        if health.state == BusState.DOWN:
            self._look_for_link(now_ns)
            return frames, arrival_ns
        for _ in range(most):
            try:
                packet, ancillary, _, _ = receive(_PACKET_BYTES, _ANCILLARY_BYTES)
            except BlockingIOError:
                self._emptied_ns = now_ns
                break
            except OSError:
                packet = b""
            if not packet:
                self._lose(now_ns)
                break
            if len(packet) == FRAME_SIZE:
                frames.append(packet)
                arrival_ns.append(self._arrival(ancillary, now_ns))
            else:
                health.malformed += 1
        else:
            health.backlog = self._more_wait()
        return frames, arrival_ns

    def send(self, frame: bytes, now_ns: int) -> None:
        """Send one frame; if the bus does not take it, it is lost and counted."""
        health = self.health
        if not health.carries:
            health.failed += 1
            return
        try:
            self._socket.send(frame)
        except OSError as error:
            if error.errno in _NO_ROOM:
                health.refused += 1
            else:
                self._lose(now_ns)

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()
        self._bus.shutdown()

    def _take(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._socket = socket.socket(fileno=os.dup(bus.fileno()))
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)

    def _arrival(self, ancillary: list[tuple[int, int, bytes]], now_ns: int) -> int:
        """When a frame arrived.

        If the wall clock was set while the frame waited, the time is wrong: it lies between the last read that left
        none and the present in any case.
        """
        arrival_ns = now_ns
        for _, kind, data in ancillary:
            if kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack(data)
                age_ns = time.time_ns() - (seconds * _NS_PER_SECOND + nanoseconds)
                arrival_ns = min(max(time.monotonic_ns() - age_ns, self._emptied_ns), now_ns)
            elif kind == _SO_RXQ_OVFL:
                self.health.overflow = self._overflow_before + int.from_bytes(data, "little")
        return arrival_ns

    def _more_wait(self) -> bool:
        try:
            return bool(self._socket.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def _lose(self, now_ns: int) -> None:
        self.health.state, self.health.backlog = BusState.DOWN, False
        self.health.failed += 1
        self._retry_ns = now_ns + RETRY_NS

    def _look_for_link(self, now_ns: int) -> None:
        if now_ns < self._retry_ns:
            return
        self._retry_ns = now_ns + RETRY_NS
        try:
            bus = open_bus(self._interface, self._channel)
        except DriverConfigError:
            return
        self._purge()
        self.close()
        self._take(bus)
        self._emptied_ns, self._overflow_before = now_ns, self.health.overflow
        self.health.state = BusState.UP

    def _purge(self) -> None:
        """Count what is left unread."""
        self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)  # or it would be the answer to the first read
        for _ in range(_MOST_PURGED):
            try:
                if not self._socket.recv(_PACKET_BYTES):
                    return
            except OSError:
                return
            self.health.purged += 1


def open_buses(interface: str, channels: Sequence[str]) -> tuple[BusSocket, ...]:
    """Open the buses of a configuration.

    Raises:
        DriverConfigError: if one cannot be opened; then none is.
    """
    opened: list[BusSocket] = []
    try:
        for channel in channels:
            opened.append(BusSocket(interface, channel))
    except DriverConfigError:
        for bus in opened:
            bus.close()
        raise
    return tuple(opened)
