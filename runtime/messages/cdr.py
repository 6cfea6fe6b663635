# SPDX-License-Identifier: Apache-2.0
"""CDR templates: a message is laid out once, strings and counts included, and later only its numbers are overwritten.

Numbers are aligned to their size, counted from the end of the four-byte encapsulation header (little-endian CDR 1).
"""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from runtime.records import CDR_LITTLE_ENDIAN

_STAMP = struct.Struct("<iI")
_COUNT = struct.Struct("<I")
_NANOSECONDS = 1_000_000_000
_EARLIEST_S, _LATEST_S = -(2**31), 2**31 - 1
"""Of builtin_interfaces/Time."""


class CdrTemplate:
    """A message under construction, then a message whose numbers can be overwritten in place.

    Slots are offsets into the payload, header included.
    """

    def __init__(self) -> None:
        self._payload = bytearray(CDR_LITTLE_ENDIAN)

    def _align(self, size: int) -> int:
        self._payload.extend(bytes(-(len(self._payload) - len(CDR_LITTLE_ENDIAN)) % size))
        return len(self._payload)

    def stamp(self) -> int:
        """Reserve a builtin_interfaces/Time; returns its slot."""
        slot = self._align(4)
        self._payload.extend(bytes(_STAMP.size))
        return slot

    def string(self, text: str) -> None:
        """Append a string."""
        encoded = text.encode() + b"\0"
        self.count(len(encoded))
        self._payload.extend(encoded)

    def count(self, number: int) -> None:
        """Append the length of a sequence."""
        self._align(4)
        self._payload.extend(_COUNT.pack(number))

    def float64(self, number: int) -> int:
        """Reserve `number` doubles, zero for now; returns the slot of the first."""
        slot = self._align(8) if number else len(self._payload)
        self._payload.extend(bytes(8 * number))
        return slot

    def float32(self, number: int) -> int:
        """Reserve `number` floats, zero for now; returns the slot of the first."""
        slot = self._align(4) if number else len(self._payload)
        self._payload.extend(bytes(4 * number))
        return slot

    def uint8(self, *values: int) -> None:
        """Append bytes, or flags."""
        self._payload.extend(values)

    def header(self, frame: str) -> int:
        """Append a std_msgs/Header; returns the slot of its stamp."""
        slot = self.stamp()
        self.string(frame)
        return slot

    def view(self, slot: int, number: int) -> npt.NDArray[np.float64]:
        """A writable array over reserved doubles; the template can no longer grow."""
        return np.ndarray((number,), "<f8", self._payload, slot)

    def float32_view(self, slot: int, number: int) -> npt.NDArray[np.float32]:
        """A writable array over reserved floats; the template can no longer grow."""
        return np.ndarray((number,), "<f4", self._payload, slot)

    def set_stamp(self, slot: int, stamp_ns: int) -> None:
        """Overwrite a stamp; the nearest that a message can tell takes the place of one beyond."""
        seconds, nanoseconds = divmod(stamp_ns, _NANOSECONDS)
        _STAMP.pack_into(self._payload, slot, min(max(seconds, _EARLIEST_S), _LATEST_S), nanoseconds)

    def to_bytes(self) -> bytes:
        """The message: encapsulation header and body."""
        return bytes(self._payload)
