# SPDX-License-Identifier: Apache-2.0
"""One bus on a real socket that never waits and never raises, whatever happens to its link.

python-can opens and configures the bus; its descriptor is then read and written directly, all frames of a tick by one
call each way that keeps the interpreter. It is the same for SocketCAN and for a `UnixHub`.

A bus whose link is lost, or down at the start, is down, and what is to be sent on it is lost and counted. It is opened
anew as soon as its link has returned, by a new socket in any case: the interface may have been deleted and made again,
and what waits in the old one is too old to be believed. Nothing is sent on a bus that is down or off, so that little
waits in the kernel when it comes back: setting a link down empties its queue, and while a live bus takes nothing (no
drive acknowledges) the small send buffer lets no more than eight or nine frames wait. Those cannot be recalled; they go
out within two milliseconds of the return, and what is sent next overrides them.

A frame carries the kernel's time of its reception, brought from the wall clock to the monotonic one.
"""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Sequence

import can

from drivers.bus_health import BusHealth, BusState
from drivers.can_frame import FRAME_SIZE
from drivers.errors import DriverConfigError, LinkDownError
from drivers.message_batch import SO_RXQ_OVFL, ReceiveBatch, SendBatch
from drivers.opening import open_bus

SEND_BUFFER_BYTES = 4096
"""Room for a few frames: what a bus cannot carry now is refused, not kept to fire when power returns."""
RETRY_NS = 100_000_000
"""How often a bus that is down is looked for."""

MOST_AT_ONCE = 64
"""Frames read or sent by one call."""

_MOST_PURGED = 1024
_NO_ROOM = (errno.EAGAIN, errno.ENOBUFS)


class BusSocket:
    """One bus.

    Args:
        interface: of python-can: socketcan, or ugv-unix.
        channel: name of the CAN interface, or path of the hub's socket.

    Attributes:
        health: of the bus.
        awaited: why it is not open yet, in a sentence; nothing if it is.

    Raises:
        DriverConfigError: if the bus cannot be opened, but for a link that is down.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self._interface, self._channel = interface, channel
        self.health = BusHealth()
        self._retry_ns = self._emptied_ns = self._overflow_before = 0
        self._receive_batch, self._send_batch = ReceiveBatch(MOST_AT_ONCE), SendBatch(MOST_AT_ONCE)
        self._bus: can.BusABC | None = None
        self.awaited = ""
        try:
            self._take(open_bus(interface, channel))
        except LinkDownError as down:
            self.awaited, self.health.state = str(down), BusState.DOWN

    def receive(self, most: int, now_ns: int) -> tuple[bytes, list[int]]:
        """Frames that wait, 16 bytes each, and when each arrived.

        Args:
            most: frames to take at most, as long as that is not above `MOST_AT_ONCE`; if more wait the bus has a
                backlog.
            now_ns: the present, by the monotonic clock.
        """
        health, most = self.health, min(most, MOST_AT_ONCE)
        health.backlog = False
        if health.state == BusState.DOWN:
            self._look_for_link(now_ns)
            return b"", []
        try:
            lengths = self._receive_batch.receive(self._descriptor, most)
        except OSError:
            self._lose(now_ns)
            return b"", []
        earliest_ns = self._emptied_ns
        if len(lengths) < most:
            self._emptied_ns = now_ns
        elif lengths and not lengths[-1]:  # the far end has closed: nothing fills the rest of the batch
            while lengths and not lengths[-1]:
                lengths.pop()
            self._lose(now_ns)
        else:
            health.backlog = self._more_wait()
        return self._read(lengths, earliest_ns, now_ns) if lengths else (b"", [])

    def send(self, frames: bytes, now_ns: int) -> None:
        """Send frames, 16 bytes each; those from the first that the bus does not take on are lost and counted."""
        health = self.health
        if not health.carries:
            health.failed += len(frames) // FRAME_SIZE
            return
        while frames:
            try:
                sent = self._send_batch.send(self._descriptor, frames)
            except OSError as error:
                left = len(frames) // FRAME_SIZE
                if error.errno in _NO_ROOM:
                    health.refused += left
                else:
                    self._lose(now_ns)
                    health.failed += left - 1
                return
            frames = frames[sent * FRAME_SIZE :]

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._socket.close()
            self._bus.shutdown()

    def _take(self, bus: can.BusABC) -> None:
        self._bus, self.awaited = bus, ""
        self._socket = socket.socket(fileno=os.dup(bus.fileno()))
        self._socket.setblocking(False)
        self._descriptor = self._socket.fileno()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)

    def _read(self, lengths: list[int], earliest_ns: int, now_ns: int) -> tuple[bytes, list[int]]:
        """Frames among the packets just read, and when each arrived.

        If the wall clock was set while a frame waited, its time is wrong: it lies between the last read that left none
        and the present in any case.
        """
        count, batch = len(lengths), self._receive_batch
        frames = batch.frames[: count * FRAME_SIZE].tobytes()
        wall_ahead_ns = time.time_ns() - time.monotonic_ns()
        arrival_ns, dropped = batch.arrivals(count, wall_ahead_ns, earliest_ns, now_ns)
        if dropped:
            self.health.overflow = self._overflow_before + dropped
        if lengths.count(FRAME_SIZE) == count:
            return frames, arrival_ns
        whole = [row for row in range(count) if lengths[row] == FRAME_SIZE]
        self.health.malformed += count - len(whole)
        return (
            b"".join(frames[row * FRAME_SIZE : (row + 1) * FRAME_SIZE] for row in whole),
            [arrival_ns[row] for row in whole],
        )

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
        if self._bus is not None:
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
                if not self._socket.recv(FRAME_SIZE):
                    return
            except OSError:
                return
            self.health.purged += 1


def open_buses(interface: str, channels: Sequence[str]) -> tuple[BusSocket, ...]:
    """Open the buses of a configuration; one whose link is down is opened as soon as that is up.

    Raises:
        DriverConfigError: if one cannot be opened for another reason; then none is.
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
