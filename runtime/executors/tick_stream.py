# SPDX-License-Identifier: Apache-2.0
"""Tick datagrams from the loops to another process, over a socket file: the loops never wait for it.

The listener owns the file, and any number of streams send to it, each from a process of its own. A stream looks for its
listener when it is made, so that the loops find it connected, and again from time to time; it counts the datagrams that
it could not hand over.
"""

from __future__ import annotations

import errno
import selectors
import socket
import threading
import time
from collections import deque
from pathlib import Path

from drivers.seqpacket import listen
from runtime.errors import UgvError
from runtime.executors.linux import send_at_once
from runtime.executors.loop_run import TickSink

RECORDER_SOCKET, LINK_SOCKET, OBSERVER_SOCKET = "recorder.sock", "link.sock", "observer.sock"
"""Socket files in the runtime directory of those who may listen."""
LOOK_AGAIN_NS = 100_000_000
SEND_BUFFER_BYTES = 4 << 20
_LONGEST_DATAGRAM = 1 << 20
_BACKLOG = 8


class TickStreamError(UgvError):
    """A socket file that cannot be made, or is another's."""


class TickStream:
    """The sending end; any thread may write.

    Args:
        path: of the listener's socket file.

    Attributes:
        dropped: datagrams that were not handed over since start.
    """

    def __init__(self, path: Path) -> None:
        self.dropped = 0
        self._path = str(path)
        self._end = self._connection()
        self._connecting, self._look_again_ns = threading.Lock(), 0

    def write(self, datagram: bytes) -> None:
        """Hand over one datagram, or count it."""
        end = self._end or self._connected()
        if end is not None:
            error = send_at_once(end.fileno(), datagram)
            if error == 0:
                return
            if error != errno.EAGAIN:
                if self._end is end:  # another thread may have a new one by now
                    self._end = None
                end.close()
        self.dropped += 1

    def _connected(self) -> socket.socket | None:
        """A new connection, unless another thread is about to make one or none could be made just now."""
        now_ns = time.monotonic_ns()
        if now_ns < self._look_again_ns or not self._connecting.acquire(blocking=False):
            return None
        try:
            self._look_again_ns = now_ns + LOOK_AGAIN_NS
            self._end = end = self._connection()
            return end
        finally:
            self._connecting.release()

    def _connection(self) -> socket.socket | None:
        end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        try:
            end.connect(self._path)
        except OSError:
            end.close()
            return None
        return end

    def close(self) -> None:
        """Let the listener see the end of the stream."""
        if self._end is not None:
            self._end.close()
            self._end = None


class TickStreams:
    """Several streams as one sink; the first is the one whose drops are told."""

    def __init__(self, first: TickSink, *others: TickSink) -> None:
        self._streams = (first, *others)

    @property
    def dropped(self) -> int:
        """Datagrams that the first stream did not hand over."""
        return self._streams[0].dropped

    def write(self, datagram: bytes) -> None:
        """Hand one datagram to each."""
        for stream in self._streams:
            stream.write(datagram)


class TickListener:
    """The receiving end.

    Args:
        path: of the socket file, which goes with the listener; one left by a process that was killed is taken over.

    Raises:
        TickStreamError: if the file cannot be made, or another process listens there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._listener = listen(path, _BACKLOG)
        except OSError as error:
            raise TickStreamError(f"{path}: cannot listen there ({error.strerror})") from None
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._ready: deque[socket.socket] = deque()
        self._room = memoryview(bytearray(_LONGEST_DATAGRAM))

    @property
    def streams(self) -> int:
        """How many streams are connected."""
        return len(self._selector.get_map()) - 1

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram of any stream, None if none comes in time; every stream in turn gives one."""
        deadline = time.monotonic() + timeout_s
        while True:
            while self._ready:
                datagram = self._take(self._ready.popleft())
                if datagram:
                    return datagram
            events = self._selector.select(max(0.0, deadline - time.monotonic()))
            if not events:
                return None
            for key, _ in events:
                end = key.fileobj
                assert isinstance(end, socket.socket)
                if end is self._listener:
                    self._admit()
                else:
                    self._ready.append(end)

    def _admit(self) -> None:
        try:
            end, _ = self._listener.accept()
        except OSError:
            return
        end.setblocking(False)
        self._selector.register(end, selectors.EVENT_READ)

    def _take(self, end: socket.socket) -> bytes:
        """One datagram of a stream; nothing if it has none, or has ended and is let go."""
        try:
            size = end.recv_into(self._room)
        except BlockingIOError:
            return b""
        except OSError:
            size = 0
        if size:
            return bytes(self._room[:size])
        self._selector.unregister(end)
        end.close()
        return b""

    def close(self) -> None:
        """Let every stream go, and remove the file."""
        for key in list(self._selector.get_map().values()):
            assert isinstance(key.fileobj, socket.socket)
            key.fileobj.close()
        self._selector.close()
        self._path.unlink(missing_ok=True)
