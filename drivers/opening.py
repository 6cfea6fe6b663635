# SPDX-License-Identifier: Apache-2.0
"""Opening the buses that a configuration names, through python-can."""

from __future__ import annotations

import errno
import fcntl
import socket
import struct

import can

from drivers.errors import DriverConfigError, LinkDownError

SOCKETCAN, UNIX = "socketcan", "ugv-unix"
"""Interfaces of python-can by which buses are opened: the kernel's, and a `UnixHub`."""

_NO_CAN = "the kernel gives no CAN socket: load can and can_raw, and let the unit use AF_CAN"
_FORBIDDEN = "this process may not open CAN sockets"
_REASONS = {
    errno.EAFNOSUPPORT: _NO_CAN,
    errno.EPROTONOSUPPORT: _NO_CAN,
    errno.EPERM: _FORBIDDEN,
    errno.EACCES: _FORBIDDEN,
    errno.ENODEV: "there is no such CAN interface",
}

_SIOCGIFFLAGS = 0x8913
_IFREQ_FLAGS = struct.Struct("16sH22x")
_IFF_UP = 0x1


def open_bus(interface: str, channel: str) -> can.BusABC:
    """Open one bus.

    Args:
        interface: of python-can: `SOCKETCAN` or `UNIX`.
        channel: name of the CAN interface, or path of the hub's socket.

    Raises:
        LinkDownError: if the interface is down.
        DriverConfigError: if it cannot be opened for another reason.
    """
    try:
        if interface == SOCKETCAN:
            _require_link(channel)
        return can.Bus(interface=interface, channel=channel, ignore_config=True)
    except OSError as error:
        raise DriverConfigError(f"{channel}: {_REASONS.get(error.errno or 0, str(error))}") from None
    except can.CanError as error:
        raise DriverConfigError(f"{channel}: {error}") from None


def _require_link(channel: str) -> None:
    """Refuse what python-can would complain of in its own log, or would accept although nothing can be sent.

    Raises:
        OSError: if there is no such link.
        LinkDownError: if it is down.
    """
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as asker:
        try:
            answer = fcntl.ioctl(asker, _SIOCGIFFLAGS, _IFREQ_FLAGS.pack(channel.encode(), 0))
        except (OSError, struct.error):
            raise OSError(errno.ENODEV, "") from None
    if not _IFREQ_FLAGS.unpack(answer)[1] & _IFF_UP:
        raise LinkDownError(f"{channel}: the CAN interface is down")
