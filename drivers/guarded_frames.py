# SPDX-License-Identifier: Apache-2.0
"""Frames that carry a checksum and an alive counter: which of them to believe, and why not the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drivers.can_frame import CAN_ERR_FLAG, CAN_RTR_FLAG, FRAME_SIZE, Frames
from drivers.errors import DriverConfigError
from drivers.vcu_database import COUNTER, GuardedMessage

_DATA = 8
"""Where the data of a frame begins."""


class Flaw(IntEnum):
    """What may be wrong with a frame; but for `MISSED` it is refused."""

    CHECKSUM = 0
    STALLED = 1
    MISSED = 2
    WRONG_LENGTH = 3
    UNKNOWN_ID = 4
    ERROR_FRAME = 5
    REMOTE_FRAME = 6
    OUT_OF_RANGE = 7


class Accepted(NamedTuple):
    """A frame to believe.

    Attributes:
        message: index of the message.
        values: of all of its signals.
        arrival_ns: ns.
    """

    message: int
    values: dict[str, float]
    arrival_ns: int


class GuardedReceiver:
    """Sorts frames by their identifiers and checks what guards them.

    Args:
        messages: to receive.
        bus: index of the bus on which they come.

    Raises:
        DriverConfigError: if the index is not that of a bus.
    """

    def __init__(self, messages: Sequence[GuardedMessage], bus: int) -> None:
        if not 0 <= bus <= np.iinfo(np.uint8).max:
            raise DriverConfigError(f"bus {bus}: must be within 0 to {np.iinfo(np.uint8).max}")
        self._messages = tuple(messages)
        self._by_address = {(bus, message.can_id): index for index, message in enumerate(messages)}

    def accepted(
        self,
        frames: Frames,
        bus: npt.NDArray[np.uint8],
        arrival_ns: npt.NDArray[np.int64],
        alive: npt.NDArray[np.uint32],
        flaws: npt.NDArray[np.uint32],
    ) -> Iterator[Accepted]:
        """The frames to believe, in their order.

        Args:
            frames: (m,).
            bus: (m,) bus index of each.
            arrival_ns: (m,) ns, of each.
            alive: (messages,) one more than the counter of each message's last frame, 0 if there was none; updated.
            flaws: (len(Flaw),) counts, updated: of `MISSED` the frames that the counters say are lacking.
        """
        raw, heads = frames.tobytes(), zip(frames["can_id"].tolist(), frames["length"].tolist(), strict=True)
        for row, ((can_id, length), wire, at_ns) in enumerate(
            zip(heads, bus.tolist(), arrival_ns.tolist(), strict=True)
        ):
            index = self._by_address.get((wire, can_id))
            if index is None:
                flaws[_flaw_of_unknown(can_id)] += 1
                continue
            message = self._messages[index]
            if length != message.length:
                flaws[Flaw.WRONG_LENGTH] += 1
                continue
            data = raw[FRAME_SIZE * row + _DATA :][:length]
            if not message.intact(data):
                flaws[Flaw.CHECKSUM] += 1
                continue
            values = message.decode(data)
            count, before = int(values[COUNTER]), int(alive[index])
            missed = (count - before) % message.counts if before else 0
            alive[index] = count + 1
            if missed == message.counts - 1:
                flaws[Flaw.STALLED] += 1
                continue
            flaws[Flaw.MISSED] += missed
            if not message.plausible(values):
                flaws[Flaw.OUT_OF_RANGE] += 1
                continue
            yield Accepted(index, values, at_ns)


def _flaw_of_unknown(can_id: int) -> Flaw:
    if can_id & CAN_ERR_FLAG:
        return Flaw.ERROR_FRAME
    return Flaw.REMOTE_FRAME if can_id & CAN_RTR_FLAG else Flaw.UNKNOWN_ID
