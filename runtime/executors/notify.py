# SPDX-License-Identifier: Apache-2.0
"""What a process tells systemd of itself (sd_notify); without systemd, nothing."""

from __future__ import annotations

import os
import socket


class Notifier:
    """Sends states to the service manager that started this process.

    Args:
        address: of its socket, as the environment says; none if empty.
    """

    def __init__(self, address: str | None = None) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "") if address is None else address
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None

    def send(self, state: str) -> None:
        """Tell one state, such as `READY=1`; a manager that does not listen is not waited for."""
        if self._socket is not None:
            try:
                self._socket.sendto(state.encode(), self._address)
            except OSError:
                return
