# SPDX-License-Identifier: Apache-2.0
"""What a bus says of itself, and what went wrong on it.

A controller reports its troubles by error frames among those received. Source: linux/can/error.h.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from drivers.can_frame import CAN_ERR_FLAG, FRAME_SIZE

_CONTROLLER = 0x004
_BUS_OFF = 0x040
_RESTARTED = 0x100
"""Classes of error frames, in the identifier."""

_WARNING, _PASSIVE, _ACTIVE = 0x0C, 0x30, 0x40
"""Of the controller class, in the second data byte: for reception or transmission, and back to normal."""

_CONTROLLER_BYTE = 9
_FLAGS_BYTE = 3
_NO_ERROR_FRAMES = bytes(flags for flags in range(256) if not flags & CAN_ERR_FLAG >> 24)


class BusState(IntEnum):
    """What a bus reports of itself."""

    UP = 0
    PASSIVE = 1
    OFF = 2
    DOWN = 3


@dataclass
class BusHealth:
    """Of one bus.

    Attributes:
        state: `BusState`.
        backlog: whether more frames waited at the last read than it took: the bus is flooded.
        refused: frames not sent since start for lack of room.
        failed: reads and writes since start that failed since the bus was down or off.
        malformed: packets since start that were no frame.
        errors: error frames since start.
        overflow: frames since start that were dropped since they were not read in time.
        purged: frames dropped since start when the bus came back, as they had become too old.
        withheld: frames not sent since start, as their commands had become too old on their way.
    """

    state: BusState = BusState.UP
    backlog: bool = False
    refused: int = 0
    failed: int = 0
    malformed: int = 0
    errors: int = 0
    overflow: int = 0
    purged: int = 0
    withheld: int = 0

    @property
    def carries(self) -> bool:
        """Whether the bus can carry frames at all."""
        return self.state < BusState.OFF

    def heed(self, error_frame: bytes) -> None:
        """Count an error frame, and take up what it says of the controller; the link's state is not its to tell."""
        self.errors += 1
        if self.state != BusState.DOWN:
            self.state = state_after(self.state, error_frame)


def state_after(before: BusState, error_frame: bytes) -> BusState:
    """State of the controller after it sent an error frame (16 bytes)."""
    classes = int.from_bytes(error_frame[:4], "little")
    if classes & _BUS_OFF:
        return BusState.OFF
    if classes & _RESTARTED:
        return BusState.UP
    if classes & _CONTROLLER:
        details = error_frame[_CONTROLLER_BYTE]
        if details & _PASSIVE:
            return BusState.PASSIVE
        if details & (_ACTIVE | _WARNING):
            return BusState.UP
    return before


def heed_errors(frames: bytes, bus: Sequence[int] | npt.NDArray[np.uint8], health: Sequence[BusHealth]) -> None:
    """Let the buses' health follow from the error frames among those received.

    Args:
        frames: (16 n,) bytes.
        bus: (n,) bus index of each.
        health: of each bus.
    """
    if not frames[_FLAGS_BYTE::FRAME_SIZE].translate(None, _NO_ERROR_FRAMES):
        return
    for row, index in enumerate(bus):
        frame = frames[row * FRAME_SIZE : (row + 1) * FRAME_SIZE]
        if frame[_FLAGS_BYTE] not in _NO_ERROR_FRAMES:
            health[index].heed(frame)


class BusReport(Protocol):
    """A record (buses,) of what `BusHealth` holds for each."""

    state: npt.NDArray[np.uint8]
    backlog: npt.NDArray[np.bool_]
    refused: npt.NDArray[np.uint32]
    failed: npt.NDArray[np.uint32]
    malformed: npt.NDArray[np.uint32]
    errors: npt.NDArray[np.uint32]
    overflow: npt.NDArray[np.uint32]
    purged: npt.NDArray[np.uint32]
    withheld: npt.NDArray[np.uint32]


class BusMonitor:
    """Reports the health of the buses, as an input port; to be read after the frames.

    Args:
        health: of each bus, kept up to date by the ports that carry the frames.
    """

    def __init__(self, health: Sequence[BusHealth]) -> None:
        self._health = tuple(health)
        self._reported = [_row(BusHealth())] * len(self._health)

    def read(self, record: BusReport, now_ns: int) -> bool:
        """Bring the record up to date.

        Returns:
            Whether anything changed since the last time.
        """
        rows = [_row(health) for health in self._health]
        if rows == self._reported:
            return False
        self._reported = rows
        columns = [np.array(column) & _UINT32 for column in zip(*rows, strict=True)]
        record.state[:], record.backlog[:], record.refused[:], record.failed[:] = columns[:4]
        record.malformed[:], record.errors[:], record.overflow[:] = columns[4:7]
        record.purged[:], record.withheld[:] = columns[7:]
        return True


_UINT32 = 0xFFFF_FFFF


def _row(health: BusHealth) -> tuple[int, ...]:
    return (
        health.state,
        health.backlog,
        health.refused,
        health.failed,
        health.malformed,
        health.errors,
        health.overflow,
        health.purged,
        health.withheld,
    )
