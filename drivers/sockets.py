# SPDX-License-Identifier: Apache-2.0
"""Opening the buses that a configuration names, through python-can."""

from __future__ import annotations

import errno
import socket

import can

from drivers.errors import DriverConfigError

SOCKETCAN, UNIX = "socketcan", "ugv-unix"
"""Interfaces of python-can by which buses are opened: the kernel's, and a `UnixHub`."""

_REASONS = {
    errno.EAFNOSUPPORT: "the kernel has no CAN: load can and can_raw",
    errno.ENODEV: "there is no such CAN interface",
    errno.EPERM: "this process may not open CAN sockets",
    errno.EACCES: "this process may not open CAN sockets",
}


def open_bus(interface: str, channel: str) -> can.BusABC:
    """Open one bus.

    Args:
        interface: of python-can: `SOCKETCAN` or `UNIX`.
        channel: name of the CAN interface, or path of the hub's socket.

    Raises:
        DriverConfigError: if it cannot be opened.
    """
    try:
        if interface == SOCKETCAN:
            _find(channel)
        return can.Bus(interface=interface, channel=channel, ignore_config=True)
    except OSError as error:
        reason = _REASONS.get(error.errno or 0, error.strerror)
        raise DriverConfigError(f"{channel}: {reason}") from None
    except can.CanError as error:
        raise DriverConfigError(f"{channel}: {error}") from None


def _find(channel: str) -> None:
    """Ask for what python-can would complain of in its own log."""
    socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    try:
        socket.if_nametoindex(channel)
    except OSError:
        raise OSError(errno.ENODEV, "") from None
