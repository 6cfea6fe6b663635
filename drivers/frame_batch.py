# SPDX-License-Identifier: Apache-2.0
"""What a loop's port reads frames into and writes them from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from drivers.can_frame import FRAME_SIZE
from drivers.errors import FrameError


class FrameBatch(Protocol):
    """A batch of frames of fixed capacity.

    Attributes:
        stamp_ns: when the batch was read or written.
        count: frames in it.
        lost: frames lost since start for lack of room.
        bus: (capacity,) bus index of each frame.
        arrival_ns: (capacity,) when each was received.
        data: (16 * capacity,) bytes of the frames.
    """

    stamp_ns: int
    count: int
    lost: int
    bus: npt.NDArray[np.uint8]
    arrival_ns: npt.NDArray[np.int64]
    data: npt.NDArray[np.uint8]


def fill(
    batch: FrameBatch,
    stamp_ns: int,
    frames: bytes,
    bus: Sequence[int] | npt.NDArray[np.uint8],
    arrival_ns: Sequence[int] | npt.NDArray[np.int64],
    lost: int,
) -> bool:
    """Replace the content of a batch; what it has no frames for becomes zero.

    Args:
        batch: with room for all of them.
        stamp_ns: of the batch.
        frames: (16 n,) their bytes.
        bus: (n,) bus index of each.
        arrival_ns: (n,) of each.
        lost: frames lost since start.

    Returns:
        Whether the batch changed; it stays as it is if there are no frames and it was empty.
    """
    count, before = len(bus), batch.count
    if not count and not before:
        return False
    batch.stamp_ns, batch.count, batch.lost = stamp_ns, count, lost
    batch.bus[:count] = bus
    batch.arrival_ns[:count] = arrival_ns
    memoryview(batch.data)[: count * FRAME_SIZE] = frames  # type: ignore[arg-type]
    if count < before:
        batch.bus[count:before] = 0
        batch.arrival_ns[count:before] = 0
        batch.data[count * FRAME_SIZE : before * FRAME_SIZE] = 0
    return True


def content(batch: FrameBatch) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Views of the bus indices (n,) and of the bytes (16 n,) of a batch's frames.

    Raises:
        FrameError: if the count exceeds the capacity.
    """
    count = batch.count
    if count > len(batch.bus):
        raise FrameError(f"a batch for {len(batch.bus)} frames claims to hold {count}")
    return batch.bus[:count], batch.data[: count * FRAME_SIZE]
