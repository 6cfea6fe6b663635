# SPDX-License-Identifier: Apache-2.0
"""python-can's view of a `UnixHub`: `can.Bus(interface="ugv-unix", channel=path)`, so that its tools can listen in."""

from __future__ import annotations

import select
import socket
import struct
import time
from typing import Any

import can

from drivers.can_frame import (
    CAN_EFF_FLAG,
    CAN_EFF_MASK,
    CAN_ERR_FLAG,
    CAN_RTR_FLAG,
    CAN_SFF_MASK,
    FRAME_SIZE,
    MAX_DATA_LENGTH,
)

_FRAME = struct.Struct("<IB3x8s")


def pack(message: can.Message) -> bytes:
    """A classic CAN message as `struct can_frame`.

    Raises:
        can.CanOperationError: for CAN FD.
    """
    if message.is_fd:
        raise can.CanOperationError("a hub carries classic CAN only")
    flags = CAN_EFF_FLAG * message.is_extended_id | CAN_RTR_FLAG * message.is_remote_frame
    flags |= CAN_ERR_FLAG * message.is_error_frame
    return _FRAME.pack(message.arbitration_id | flags, message.dlc, bytes(message.data))


def unpack(frame: bytes, timestamp: float, channel: str) -> can.Message:
    """The message of a `struct can_frame`.

    Raises:
        can.CanOperationError: if it is none.
    """
    if len(frame) != FRAME_SIZE:
        raise can.CanOperationError(f"{channel} gave {len(frame)} bytes where a CAN frame has {FRAME_SIZE}")
    identifier, length, data = _FRAME.unpack(frame)
    if length > MAX_DATA_LENGTH:
        raise can.CanOperationError(
            f"{channel} gave a frame of {length} data bytes where {MAX_DATA_LENGTH} are the most"
        )
    extended, remote = bool(identifier & CAN_EFF_FLAG), bool(identifier & CAN_RTR_FLAG)
    return can.Message(
        timestamp=timestamp,
        arbitration_id=identifier & (CAN_EFF_MASK if extended or identifier & CAN_ERR_FLAG else CAN_SFF_MASK),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=bool(identifier & CAN_ERR_FLAG),
        dlc=length,
        data=None if remote else data[:length],
        channel=channel,
    )


class UnixCanBus(can.BusABC):
    """One end of a hub's bus.

    Args:
        channel: path of the hub's socket.

    Raises:
        can.CanInitializationError: if there is no hub.
    """

    def __init__(self, channel: str, can_filters: Any = None, **options: object) -> None:
        self.channel, self.channel_info = str(channel), f"CAN hub at {channel}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)  # a hub that hangs must not hang those who look for it
        try:
            self._socket.connect(self.channel)
            self._socket.setblocking(True)
        except OSError as error:
            self._socket.close()
            raise can.CanInitializationError(f"no CAN hub at {channel} ({error.strerror})") from None
        super().__init__(channel=channel, can_filters=can_filters, **options)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message; waits for room in the socket's queue, for ever if no timeout is given."""
        frame = pack(msg)
        _, ready, _ = select.select([], [self._socket], [], timeout)
        if not ready:
            raise can.CanTimeoutError(f"{self.channel_info} takes no frame")
        try:
            self._socket.send(frame, socket.MSG_NOSIGNAL)
        except OSError as error:
            raise can.CanOperationError(f"{self.channel_info} is gone ({error.strerror})") from None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        ready, _, _ = select.select([self._socket], [], [], timeout)
        if not ready:
            return None, False
        frame = self._socket.recv(2 * FRAME_SIZE)
        if not frame:
            raise can.CanOperationError(f"{self.channel_info} is gone")
        return unpack(frame, time.time(), self.channel), False

    def fileno(self) -> int:
        """The socket's descriptor."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._socket.close()
