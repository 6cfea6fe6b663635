# SPDX-License-Identifier: Apache-2.0
"""A stream of tick datagrams between processes in virtual time; it holds as much as the socket of a `TickStream`."""

from __future__ import annotations

from collections import deque

from runtime.executors.tick_stream import SEND_BUFFER_BYTES


class VirtualStream:
    """Takes datagrams until it is full, as a `TickSink`; nobody waits for it.

    Attributes:
        dropped: datagrams that were not taken since start.
        written: datagrams that were handed to it since start.
        heard: whether anybody listens.
    """

    def __init__(self) -> None:
        self.dropped = self.written = 0
        self.heard = True
        self._waiting: deque[bytes] = deque()
        self._bytes = 0

    def write(self, datagram: bytes) -> None:
        """Take a datagram, or count it."""
        self.written += 1
        if not self.heard or self._bytes + len(datagram) > SEND_BUFFER_BYTES:
            self.dropped += 1
            return
        self._bytes += len(datagram)
        self._waiting.append(datagram)

    def take(self) -> bytes | None:
        """The oldest datagram; None if there is none."""
        if not self._waiting:
            return None
        datagram = self._waiting.popleft()
        self._bytes -= len(datagram)
        return datagram

    def break_off(self) -> int:
        """The listener is gone, and with it what waited: how many datagrams that is."""
        lost, self.heard = len(self._waiting), False
        self._waiting.clear()
        self._bytes = 0
        return lost
