# SPDX-License-Identifier: Apache-2.0
"""A CAN bus for machines whose kernel has none: SocketCAN's 16-byte frames over AF_UNIX SEQPACKET.

Each bus is a socket file with a hub behind it. What one end sends, the hub's owner and every other end receive, in the
order in which the hub got it. The hub has no thread: it works when its owner calls it.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from pathlib import Path

from drivers.can_frame import FRAME_SIZE
from drivers.errors import DriverConfigError
from drivers.seqpacket import listen

_BACKLOG = 16
_MOST_PACKETS = 256
"""Taken from one end at once, so that a flood does not hold the hub's owner up."""


class UnixHub:
    """One bus.

    Args:
        path: of the socket file, which goes with the hub; one left by a hub that was killed is taken over.

    Attributes:
        dropped: frames that an end did not get since its queue was full.
        rejected: packets that were not one frame.

    Raises:
        DriverConfigError: if the socket cannot be made or another hub is behind it.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.dropped, self.rejected = path, 0, 0
        self._ends: list[socket.socket] = []
        try:
            self._listener = listen(path, _BACKLOG)
        except OSError as error:
            raise DriverConfigError(f"{path}: no CAN hub can be made there ({error.strerror})") from None
        self._poll = select.epoll()
        self._poll.register(self._listener, select.EPOLLIN)

    def receive(self) -> bytes:
        """Pass on what the ends sent since the last call; returns it, 16 bytes a frame, in order of arrival.

        Of an end that floods the bus the rest is left for the next call.
        """
        ready = {descriptor for descriptor, _ in self._poll.poll(0)}
        if self._listener.fileno() in ready:
            ready |= self._admit()
        received = []
        for end in [end for end in self._ends if end.fileno() in ready]:
            for frame in self._packets(end):
                received.append(frame)
                self._send(frame, end)
        return b"".join(received)

    def _admit(self) -> set[int]:
        """Take in the ends that wait; gives their descriptors."""
        admitted = set()
        with contextlib.suppress(BlockingIOError):
            while True:
                end = self._listener.accept()[0]
                end.setblocking(False)
                self._poll.register(end, select.EPOLLIN)
                self._ends.append(end)
                admitted.add(end.fileno())
        return admitted

    def send(self, frames: bytes) -> None:
        """Send the owner's frames, 16 bytes each, to every end."""
        for begin in range(0, len(frames), FRAME_SIZE):
            self._send(frames[begin : begin + FRAME_SIZE], None)

    def _packets(self, end: socket.socket) -> list[bytes]:
        packets: list[bytes] = []
        for _ in range(_MOST_PACKETS):
            try:
                packet = end.recv(2 * FRAME_SIZE)
            except BlockingIOError:
                break
            except OSError:
                packet = b""
            if not packet:
                self._leave(end)
                break
            if len(packet) == FRAME_SIZE:
                packets.append(packet)
            else:
                self.rejected += 1
        return packets

    def _send(self, frame: bytes, sender: socket.socket | None) -> None:
        for end in list(self._ends):
            if end is sender:
                continue
            try:
                end.send(frame, socket.MSG_NOSIGNAL)
            except BlockingIOError:
                self.dropped += 1
            except OSError:
                self._leave(end)

    def _leave(self, end: socket.socket) -> None:
        if end in self._ends:
            self._ends.remove(end)
            end.close()  # which also ends its registration

    def close(self) -> None:
        """End the bus; its ends are told so by their sockets."""
        for end in list(self._ends):
            self._leave(end)
        self._poll.close()
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self.path)
