# SPDX-License-Identifier: Apache-2.0
"""Many packets of a socket read or sent by one call that keeps the interpreter.

A call of Python's socket module gives up the GIL, and a real-time thread waits a whole switch interval to get it back
from a thread that computes. So `recvmmsg` and `sendmmsg` are called through `ctypes.PyDLL`, which keeps it. They never
wait (MSG_DONTWAIT), and the kernel needs less time for all packets of a tick than a switch interval.

What the kernel reads and writes is allocated and linked once: for each packet a header with its place among the
frames, which lie side by side, and a place for what is told beside it. Sources: recvmmsg(2), sendmmsg(2), cmsg(3);
Linux on a 64-bit machine, with glibc or musl.
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.can_frame import FRAME_SIZE

SO_TIMESTAMPNS, SO_RXQ_OVFL = 35, 40
"""Missing from Python's socket module: they ask for what is told beside a packet, and are the types of it as well."""

_LIBC = ctypes.PyDLL(None, use_errno=True)
_RECEIVE_FLAGS = int(socket.MSG_DONTWAIT)
_SEND_FLAGS = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
_BUFFER = np.dtype([("address", np.uintp), ("size", np.uintp)], align=True)
"""`struct iovec`."""
_HEADER = np.dtype(
    [
        ("name", np.uintp),
        ("name_size", np.uint32),
        ("buffers", np.uintp),
        ("buffer_count", np.uintp),
        ("control", np.uintp),
        ("control_size", np.uintp),
        ("flags", np.int32),
    ],
    align=True,
)
"""`struct msghdr`."""
_MESSAGE = np.dtype([("header", _HEADER), ("length", np.uint32)], align=True)
"""`struct mmsghdr`."""

_CMSG = struct.Struct("@Nii")
"""`struct cmsghdr`: size, level and type; the data follow."""
_TIMESPEC = struct.Struct("@qq")
_DROPPED = struct.Struct("@I")
_CONTROL_SIZE = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_DROPPED.size)
_USUAL = struct.Struct(f"@{_CMSG.size}sqq{_CMSG.size}sI4x")
"""The stamp, then the drops if there were any, as the kernel is used to order them."""
_STAMP_HEAD = _CMSG.pack(socket.CMSG_LEN(_TIMESPEC.size), socket.SOL_SOCKET, SO_TIMESTAMPNS)
_DROPPED_HEAD = _CMSG.pack(socket.CMSG_LEN(_DROPPED.size), socket.SOL_SOCKET, SO_RXQ_OVFL)
_NO_HEAD = bytes(_CMSG.size)
_NS_PER_SECOND = 1_000_000_000


class ReceiveBatch:
    """Room for packets that one call reads, each meant to be one frame.

    Args:
        capacity: packets read at once at most.

    Attributes:
        capacity: the same.
        frames: (16 * capacity,) bytes; those of the packets of the last call come first, 16 each.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._frames = np.zeros((capacity, FRAME_SIZE), np.uint8)
        self._excess = np.zeros(FRAME_SIZE, np.uint8)
        control = np.zeros((capacity, _CONTROL_SIZE), np.uint8)
        # what a packet has beyond a frame goes to the excess, so that its length tells it from a frame
        self._buffers = np.zeros((capacity, 2), _BUFFER)
        self._buffers["address"][:, 0] = _addresses(self._frames)
        self._buffers["address"][:, 1] = self._excess.ctypes.data
        self._buffers["size"] = FRAME_SIZE
        self._messages = _messages(self._buffers)
        self._messages["header"]["control"] = _addresses(control)
        self._messages["header"]["control_size"] = _CONTROL_SIZE
        self._lengths = self._messages["length"]
        self._headers, self._fresh_headers = self._messages.view(np.uint8).data, self._messages.tobytes()
        self._control, self._fresh_control = control.reshape(-1).data, control.tobytes()
        self._first = ctypes.c_void_p(self._messages.ctypes.data)
        self.frames = self._frames.reshape(-1).data

    def receive(self, descriptor: int, most: int) -> list[int]:
        """Read the packets that wait.

        Args:
            descriptor: of the socket.
            most: packets to read; beyond the capacity none are.

        Returns:
            The length of each, above a frame's if it is longer than one; zeros where the far end has closed.

        Raises:
            OSError: if the socket failed.
        """
        self._headers[:], self._control[:] = self._fresh_headers, self._fresh_control
        count = _LIBC.recvmmsg(descriptor, self._first, min(most, self.capacity), _RECEIVE_FLAGS, None)
        if count < 0:
            error = _error()
            if error.errno == errno.EAGAIN:
                return []
            raise error
        lengths: list[int] = self._lengths[:count].tolist()
        return lengths

    def arrivals(self, count: int, wall_ahead_ns: int, earliest_ns: int, latest_ns: int) -> tuple[list[int], int]:
        """When the first `count` packets of the last call arrived, and how many packets the socket had dropped then.

        Args:
            count: of packets.
            wall_ahead_ns: of the wall clock, by which the kernel stamps, before the monotonic clock.
            earliest_ns: that an arrival can be; where the kernel told another time, the wall clock was set meanwhile.
            latest_ns: that an arrival can be; also where the kernel did not tell.

        Returns:
            Times by the monotonic clock, and the drops since the socket was opened, zero if none are told.
        """
        arrival_ns: list[int] = []
        dropped = 0
        control = self._control[: count * _CONTROL_SIZE]
        for head, seconds, nanoseconds, next_head, drops in _USUAL.iter_unpack(control):
            if head == _STAMP_HEAD and next_head in (_NO_HEAD, _DROPPED_HEAD):
                stamp_ns = seconds * _NS_PER_SECOND + nanoseconds
            elif head == _NO_HEAD:
                stamp_ns, drops = None, 0
            else:
                begin = len(arrival_ns) * _CONTROL_SIZE
                stamp_ns, drops = parse_ancillary(bytes(control[begin : begin + _CONTROL_SIZE]))
            at_ns = latest_ns if stamp_ns is None else stamp_ns - wall_ahead_ns
            arrival_ns.append(earliest_ns if at_ns < earliest_ns else latest_ns if at_ns > latest_ns else at_ns)
            dropped = drops or dropped
        return arrival_ns, dropped


class SendBatch:
    """Room for frames that one call sends.

    Args:
        capacity: frames sent at once at most.
    """

    def __init__(self, capacity: int) -> None:
        self._frames = np.zeros((capacity, FRAME_SIZE), np.uint8)
        self._buffers = np.zeros((capacity, 1), _BUFFER)
        self._buffers["address"][:, 0] = _addresses(self._frames)
        self._buffers["size"] = FRAME_SIZE
        self._messages = _messages(self._buffers)
        self._first = ctypes.c_void_p(self._messages.ctypes.data)
        self._bytes = self._frames.reshape(-1).data

    def send(self, descriptor: int, frames: bytes) -> int:
        """Send frames, 16 bytes each, up to the first that is not taken.

        Args:
            descriptor: of the socket.
            frames: at least one; what exceeds the capacity is not sent.

        Returns:
            How many were taken, at least one.

        Raises:
            OSError: if the first was not taken.
        """
        frames = frames[: len(self._bytes)]
        self._bytes[: len(frames)] = frames
        sent: int = _LIBC.sendmmsg(descriptor, self._first, len(frames) // FRAME_SIZE, _SEND_FLAGS)
        if sent < 0:
            raise _error()
        return sent


def parse_ancillary(control: bytes) -> tuple[int | None, int]:
    """When a packet arrived, in ns of the wall clock, if that is told, and how many were dropped before, else zero.

    Args:
        control: `struct cmsghdr` and data, any number of times and in any order; zeros after the last.
    """
    stamp_ns, dropped, begin = None, 0, 0
    while begin + _CMSG.size <= len(control):
        size, level, kind = _CMSG.unpack_from(control, begin)
        if size < _CMSG.size:
            break
        data = control[begin + _CMSG.size : begin + size]
        if (level, kind, len(data)) == (socket.SOL_SOCKET, SO_TIMESTAMPNS, _TIMESPEC.size):
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            stamp_ns = seconds * _NS_PER_SECOND + nanoseconds
        elif (level, kind, len(data)) == (socket.SOL_SOCKET, SO_RXQ_OVFL, _DROPPED.size):
            (dropped,) = _DROPPED.unpack(data)
        begin += socket.CMSG_SPACE(len(data))
    return stamp_ns, dropped


def _messages(buffers: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Headers (n,) of packets that lie in buffers (n, parts)."""
    messages = np.zeros(len(buffers), _MESSAGE)
    messages["header"]["buffers"] = _addresses(buffers)
    messages["header"]["buffer_count"] = buffers.shape[1]
    return messages


def _addresses(rows: npt.NDArray[Any]) -> npt.NDArray[np.uintp]:
    """Where each row of an array lies."""
    return rows.ctypes.data + np.arange(len(rows), dtype=np.uintp) * rows.strides[0]


def _error() -> OSError:
    number = ctypes.get_errno()
    return OSError(number, os.strerror(number))
