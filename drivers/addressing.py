# SPDX-License-Identifier: Apache-2.0
"""Which drive a frame belongs to, and why a frame belongs to none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from drivers.can_frame import CAN_ERR_FLAG, CAN_RTR_FLAG, Frames
from drivers.dialects import Dialect
from drivers.errors import DriverConfigError
from drivers.joints import Joint


class Rejection(IntEnum):
    """Kinds of frames that are refused and counted."""

    WRONG_LENGTH = 0
    UNKNOWN_ID = 1
    ERROR_FRAME = 2
    REMOTE_FRAME = 3
    OUT_OF_RANGE = 4


@dataclass(frozen=True)
class Identified:
    """What a batch of frames is.

    Attributes:
        rows: (m,) rows of the accepted frames, in order.
        drives: (m,) drive of each accepted frame.
        heard: (n,) whether each drive has a frame in the batch.
        all_heard: whether every drive has.
        in_order: whether the batch is exactly one accepted frame of every drive, in their order.
        rejections: how many frames of each kind, indexed by `Rejection`.
        any_rejected: whether any was.
    """

    rows: npt.NDArray[np.intp]
    drives: npt.NDArray[np.intp]
    heard: npt.NDArray[np.bool_]
    all_heard: bool
    in_order: bool
    rejections: npt.NDArray[np.uint32]
    any_rejected: bool


class AddressBook:
    """Tells frames apart by bus, identifier, length and, where the dialect has it, the id within the data.

    The answer depends on nothing but those bytes; `drivers.patterns.Recognizer` remembers it.

    Args:
        drives: number of drives.
        length: data bytes of a valid frame.
        entries: drive by (bus, can_id with flags, id within the data).
        id_mask: bits of the first data byte that hold the id; 0 if it is not in the data.
    """

    def __init__(self, drives: int, length: int, entries: Mapping[tuple[int, int, int], int], id_mask: int) -> None:
        self._drives, self._length, self._entries, self._id_mask = drives, length, dict(entries), id_mask

    def identify(self, frames: Frames, bus: npt.NDArray[np.uint8]) -> Identified:
        """Sort a batch of frames (m,) that came from the buses (m,)."""
        rejections = np.zeros(len(Rejection), np.uint32)
        accepted: list[tuple[int, int]] = []
        columns = (frames["can_id"], frames["length"], bus, frames["data"][:, 0])
        for row, (can_id, length, wire, first) in enumerate(zip(*(c.tolist() for c in columns), strict=True)):
            drive = self._entries.get((wire, can_id, first & self._id_mask))
            if can_id & CAN_ERR_FLAG:
                rejections[Rejection.ERROR_FRAME] += 1
            elif can_id & CAN_RTR_FLAG:
                rejections[Rejection.REMOTE_FRAME] += 1
            elif drive is None:
                rejections[Rejection.UNKNOWN_ID] += 1
            elif length != self._length:
                rejections[Rejection.WRONG_LENGTH] += 1
            else:
                accepted.append((row, drive))
        rows = np.array([row for row, _ in accepted], np.intp)
        drives = np.array([drive for _, drive in accepted], np.intp)
        heard = np.zeros(self._drives, np.bool_)
        heard[drives] = True
        in_order = len(frames) == self._drives and drives.tolist() == list(range(self._drives))
        return Identified(rows, drives, heard, bool(heard.all()), in_order, rejections, bool(rejections.any()))


def command_addresses(dialect: Dialect, joints: Sequence[Joint]) -> AddressBook:
    """The book by which drives know the commands meant for them.

    Raises:
        DriverConfigError: if two drives share an address.
    """
    entries: dict[tuple[int, int, int], int] = {}
    for index, joint in enumerate(joints):
        _enter(entries, (joint.bus, dialect.command_id(joint.drive_id), 0), index, joints)
    return AddressBook(len(joints), dialect.command_length, entries, 0)


def reply_addresses(dialect: Dialect, joints: Sequence[Joint]) -> AddressBook:
    """The book by which the controller knows the replies.

    Raises:
        DriverConfigError: if the replies of two drives cannot be told apart, or a drive would take one for a command.
    """
    entries: dict[tuple[int, int, int], int] = {}
    commanded = {(joint.bus, dialect.command_id(joint.drive_id)): joint.name for joint in joints}
    mask = reply_id_mask(dialect)
    for index, joint in enumerate(joints):
        address = (joint.bus, dialect.reply_id(joint.drive_id, joint.master_id), joint.drive_id & mask)
        if address[:2] in commanded:
            raise DriverConfigError(
                f"joint {joint.name}: replies go to id {address[1]:#x} on bus {joint.bus}, where the drive of "
                f"{commanded[address[:2]]} would take them for commands"
            )
        _enter(entries, address, index, joints)
    return AddressBook(len(joints), dialect.reply_length, entries, mask)


def reply_id_mask(dialect: Dialect) -> int:
    """Bits of a reply's first byte that hold the drive's id; 0 if the dialect has none there."""
    used = 0
    for field in dialect.reply:
        if field.name == "id":
            return ((1 << field.bits) - 1) << (8 - used - field.bits)
        used += field.bits
    return 0


def _enter(
    entries: dict[tuple[int, int, int], int], address: tuple[int, int, int], index: int, joints: Sequence[Joint]
) -> None:
    if address in entries:
        other = joints[entries[address]].name
        raise DriverConfigError(
            f"joints {other} and {joints[index].name} share id {address[1]:#x} on bus {address[0]}"
            + (f" with {address[2]:#x} in the data" if address[2] else "")
        )
    entries[address] = index
