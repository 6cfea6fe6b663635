# SPDX-License-Identifier: Apache-2.0
"""Listening sockets of AF_UNIX SEQPACKET, each at a socket file."""

from __future__ import annotations

import errno
import socket
from pathlib import Path


def listen(path: Path, backlog: int) -> socket.socket:
    """A non-blocking socket that listens at a socket file; one left by a process that was killed is taken over.

    Raises:
        OSError: if the file cannot be made, or another process listens there.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    try:
        _take_over(path)
        listener.bind(str(path))
        listener.listen(backlog)
    except OSError:
        listener.close()
        raise
    return listener


def _take_over(path: Path) -> None:
    """Remove a socket file that nobody listens at."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        try:
            probe.connect(str(path))
        except FileNotFoundError:
            return
        except ConnectionRefusedError:
            path.unlink()
            return
    raise OSError(errno.EADDRINUSE, "another process listens there")
