# SPDX-License-Identifier: Apache-2.0
"""The 16-byte `struct can_frame` of Linux, and how long a frame occupies a classic CAN bus.

Sources: linux/can.h for the layout; ISO 11898-1 for the bits: start of frame to CRC is subject to stuffing (one bit
after every five equal ones, the stuff bits included), then come 10 fixed bits and 3 bits of interframe space.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.errors import FrameError

CAN_EFF_FLAG = 0x8000_0000
"""Extended frame: 29-bit identifier."""
CAN_RTR_FLAG = 0x4000_0000
"""Remote request: no data."""
CAN_ERR_FLAG = 0x2000_0000
"""Not a frame of the bus but the controller's report of an error."""
CAN_SFF_MASK = 0x0000_07FF
CAN_EFF_MASK = 0x1FFF_FFFF

FRAME_SIZE = 16
MAX_DATA_LENGTH = 8

CAN_FRAME = np.dtype([("can_id", "<u4"), ("length", "u1"), ("padding", "u1", (3,)), ("data", "u1", (8,))])
"""One frame; a batch of n frames is a view of n * 16 bytes."""

FRAME_WORDS = np.dtype([("head", "<u8"), ("word", ">u8")])
"""The same 16 bytes as two numbers: identifier with length, and the data with its first byte most significant."""

Frames = npt.NDArray[Any]
"""An array of dtype `CAN_FRAME`."""

_FIXED_BITS = 13
_STANDARD_STUFFABLE = 34
_EXTENDED_STUFFABLE = 54
_CRC_POLYNOMIAL = 0x4599
_CRC_BITS = 15


def as_frames(data: npt.NDArray[np.uint8]) -> Frames:
    """View bytes (n * 16,) as n frames, without copying.

    Raises:
        FrameError: if the bytes are not whole frames.
    """
    if data.size % FRAME_SIZE:
        raise FrameError(f"{data.size} bytes are not a whole number of {FRAME_SIZE}-byte CAN frames")
    return data.view(CAN_FRAME)


def make_frames(can_ids: Sequence[int], length: int, data: bytes = bytes(MAX_DATA_LENGTH)) -> Frames:
    """Frames with the given identifiers (flags included) and the same length and data bytes.

    Raises:
        FrameError: if the length is above 8 or the data longer than 8 bytes.
    """
    if not 0 <= length <= MAX_DATA_LENGTH or len(data) > MAX_DATA_LENGTH:
        raise FrameError(f"a classic CAN frame has at most 8 data bytes, not {max(length, len(data))}")
    frames = np.zeros(len(can_ids), CAN_FRAME)
    frames["can_id"] = can_ids
    frames["length"] = length
    frames["data"][:, : len(data)] = np.frombuffer(data, np.uint8)
    return frames


def arbitration_priority(can_id: int) -> int:
    """The identifier as the bus compares it: of frames that start together the smallest number goes first.

    A standard frame beats an extended one of the same first 11 bits, and data beats a remote request.
    """
    remote = int(bool(can_id & CAN_RTR_FLAG))
    if can_id & CAN_EFF_FLAG:
        identifier = can_id & CAN_EFF_MASK
        return (identifier >> 18) << 21 | 0b11 << 19 | (identifier & 0x3FFFF) << 1 | remote
    return (can_id & CAN_SFF_MASK) << 21 | remote << 20


def min_frame_bits(length: int, extended: bool) -> int:
    """Bits of a frame with `length` data bytes and no stuffing, interframe space included (111 or 131 for 8 bytes)."""
    return _stuffable_bits(length, extended) + _FIXED_BITS


def max_frame_bits(length: int, extended: bool) -> int:
    """Bits of a frame with `length` data bytes and the most stuffing, interframe space included (135 or 160 for 8)."""
    stuffable = _stuffable_bits(length, extended)
    return stuffable + (stuffable - 1) // 4 + _FIXED_BITS


def frame_bits(can_id: int, data: bytes) -> int:
    """Exact bits of one data or remote frame on the bus, with its own CRC and stuffing and the interframe space."""
    extended, remote = bool(can_id & CAN_EFF_FLAG), int(bool(can_id & CAN_RTR_FLAG))
    if extended:
        identifier = can_id & CAN_EFF_MASK
        head = f"0{identifier >> 18:011b}11{identifier & 0x3FFFF:018b}{remote}00{len(data):04b}"
    else:
        head = f"0{can_id & CAN_SFF_MASK:011b}{remote}00{len(data):04b}"
    bits = [int(bit) for bit in head]
    if not remote:
        bits += [byte >> (7 - place) & 1 for byte in data for place in range(8)]
    crc = _crc15(bits)
    bits += [crc >> (_CRC_BITS - 1 - place) & 1 for place in range(_CRC_BITS)]
    return len(bits) + _stuff_bits(bits) + _FIXED_BITS


def _stuffable_bits(length: int, extended: bool) -> int:
    return (_EXTENDED_STUFFABLE if extended else _STANDARD_STUFFABLE) + 8 * min(length, MAX_DATA_LENGTH)


def _crc15(bits: Sequence[int]) -> int:
    crc = 0
    for bit in bits:
        feedback = bit ^ (crc >> (_CRC_BITS - 1))
        crc = (crc << 1) & ((1 << _CRC_BITS) - 1)
        if feedback:
            crc ^= _CRC_POLYNOMIAL
    return crc


def _stuff_bits(bits: Sequence[int]) -> int:
    stuffed, last, run = 0, -1, 0
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed += 1
            last, run = 1 - bit, 1
    return stuffed
