# SPDX-License-Identifier: Apache-2.0
"""What batches of frames have in common from period to period: identifiers, lengths and buses.

A batch is recognised by masking all else out of its bytes as one long number. That is two steps whatever the number of
frames, where looking at the fields takes several numpy calls.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from drivers.addressing import AddressBook, Identified
from drivers.can_frame import FRAME_SIZE, Frames
from drivers.mit import Words

_HEAD = bytes([0xFF] * 5 + [0] * 11)
"""Of a frame the bytes that hold the identifier, its flags and the length."""
_FIRST_DATA_BYTE = 8
_REMEMBERED = 64
_BIG_ENDIAN_WORD = np.dtype(">u8")


@lru_cache(256)
def _mask(frames: int, first_data_byte: bool) -> int:
    one = bytearray(_HEAD)
    one[_FIRST_DATA_BYTE] = 0xFF if first_data_byte else 0
    return int.from_bytes(bytes(one) * frames, "little")


def heads(raw: bytes) -> int:
    """Identifiers and lengths of a batch of frames, given and returned as their bytes with all else zero."""
    return int.from_bytes(raw, "little") & _mask(len(raw) // FRAME_SIZE, False)


def data_words(raw: bytes) -> Words:
    """The data of a batch of frames, given as its bytes, as words (n,)."""
    return np.frombuffer(raw, _BIG_ENDIAN_WORD)[1::2]


class Recognizer:
    """Asks an address book about each pattern once.

    Args:
        book: to ask.
        id_in_data: whether a drive's id is in the first data byte.
    """

    def __init__(self, book: AddressBook, id_in_data: bool) -> None:
        self._book, self._id_in_data = book, id_in_data
        self._known: dict[tuple[int, bytes], Identified] = {}

    def identify(self, raw: bytes, frames: Frames, bus: npt.NDArray[np.uint8]) -> Identified:
        """Sort a batch of frames (m,), whose bytes are `raw`, that came from the buses (m,)."""
        pattern = int.from_bytes(raw, "little") & _mask(len(raw) // FRAME_SIZE, self._id_in_data), bus.tobytes()
        found = self._known.get(pattern)
        if found is None:
            if len(self._known) >= _REMEMBERED:
                self._known.clear()
            found = self._known[pattern] = self._book.identify(frames, bus)
        return found
