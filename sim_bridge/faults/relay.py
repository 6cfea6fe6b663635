# SPDX-License-Identifier: Apache-2.0
"""A network between two ends of a TCP connection, which can be partitioned: nothing then passes, and nobody is told."""

from __future__ import annotations

import selectors
import socket
import threading
from contextlib import suppress
from types import TracebackType

_CHUNK = 1 << 16
_LOOK_S = 0.02
_BACKLOG = 16


class Relay:
    """Carries every connection to it on to a port of this machine; use as a context manager.

    Args:
        port: where connections are carried to.

    Attributes:
        port: where it listens itself.
    """

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=_BACKLOG)
        self.port: int = self._listener.getsockname()[1]
        self._far: dict[socket.socket, socket.socket] = {}
        self._partitioned, self._ended = threading.Event(), threading.Event()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._carry, name="relay", daemon=True)

    def partition(self) -> None:
        """Let nothing pass."""
        self._partitioned.set()

    def heal(self) -> None:
        """Let everything pass again, also what waits."""
        self._partitioned.clear()

    def _carry(self) -> None:
        while not self._ended.is_set():
            if self._partitioned.is_set():
                self._ended.wait(_LOOK_S)
                continue
            for key, _ in self._selector.select(_LOOK_S):
                end = key.fileobj
                assert isinstance(end, socket.socket)
                if end is self._listener:
                    self._admit()
                elif end in self._far:
                    self._pass_on(end)

    def _admit(self) -> None:
        near, _ = self._listener.accept()
        try:
            far = socket.create_connection(self._target)
        except OSError:
            near.close()
            return
        for one, other in ((near, far), (far, near)):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._far[one] = other
            self._selector.register(one, selectors.EVENT_READ)

    def _pass_on(self, end: socket.socket) -> None:
        try:
            data = end.recv(_CHUNK)
            if data:
                self._far[end].sendall(data)
                return
        except OSError:
            pass
        for one in (end, self._far[end]):
            self._selector.unregister(one)
            del self._far[one]
            one.close()

    def __enter__(self) -> Relay:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        for end in [*self._far, self._listener]:
            with suppress(OSError):
                end.close()
        self._selector.close()
