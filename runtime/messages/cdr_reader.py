# SPDX-License-Identifier: Apache-2.0
"""Reads a message from CDR bytes that anybody may have sent: for any bytes it gives values or a `MessageError`.

Nothing is taken that is not in the buffer, and nothing larger than the buffer is made of it.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.messages.errors import MessageError

_HEADER_BYTES = 4
_LONGEST_PADDING = 3
_NANOSECONDS = 1_000_000_000
_SIZES = {"b": 1, "B": 1, "i": 4, "I": 4, "f": 4, "d": 8}
_SHORT = "the message ends too early"


@lru_cache(maxsize=64)
def _layout(text: str) -> struct.Struct:
    return struct.Struct(text)


class CdrReader:
    """A message, read from its beginning to its end; element types are those of `struct`.

    Args:
        payload: encapsulation header and body, little- or big-endian CDR 1.

    Raises:
        MessageError: by every method, if the bytes are not what is read.
    """

    def __init__(self, payload: bytes) -> None:
        if len(payload) < _HEADER_BYTES:
            raise MessageError(_SHORT)
        if payload[0] or payload[1] > 1:
            raise MessageError("the encapsulation is not plain CDR")
        self._order = "<" if payload[1] else ">"
        self._payload, self._at = payload, _HEADER_BYTES

    def _claim(self, kind: str, number: int) -> int:
        """The place of some elements, which are then passed."""
        size = _SIZES[kind]
        begin = self._at + -(self._at - _HEADER_BYTES) % size if number else self._at
        end = begin + number * size
        if end > len(self._payload):
            raise MessageError(_SHORT)
        self._at = end
        return begin

    def numbers(self, kind: str, number: int = 1) -> tuple[Any, ...]:
        """Some numbers of one type; for few of them."""
        begin = self._claim(kind, number)
        return _layout(f"{self._order}{number}{kind}").unpack_from(self._payload, begin)

    def array(self, kind: str, number: int) -> npt.NDArray[Any]:
        """An array of numbers of one type."""
        begin = self._claim(kind, number)
        return np.frombuffer(self._payload, f"{self._order}{kind}", number, begin).astype(f"={kind}")

    def count(self) -> int:
        """The length of a sequence; what it claims is not yet proved to be there."""
        return int(self.numbers("I")[0])

    def boolean(self) -> bool:
        """A flag."""
        value = self.numbers("B")[0]
        if value > 1:
            raise MessageError("a flag is neither true nor false")
        return bool(value)

    def string(self) -> str:
        """A text, which ends with a zero byte that is not part of it; a few writers leave both out when it is empty."""
        length = self.count()
        if not length:
            return ""
        begin = self._claim("B", length)
        encoded = self._payload[begin : begin + length]
        if encoded[-1]:
            raise MessageError("a text has no end")
        try:
            return encoded[:-1].decode()
        except UnicodeDecodeError:
            raise MessageError("a text is not UTF-8") from None

    def stamp_ns(self) -> int:
        """A builtin_interfaces/Time as nanoseconds."""
        (seconds,), (nanoseconds,) = self.numbers("i"), self.numbers("I")
        if nanoseconds >= _NANOSECONDS:
            raise MessageError("a stamp has a second's worth of nanoseconds or more")
        return int(seconds) * _NANOSECONDS + int(nanoseconds)

    def header(self) -> tuple[int, str]:
        """A std_msgs/Header: stamp in ns, frame."""
        return self.stamp_ns(), self.string()

    @property
    def remaining(self) -> int:
        """Bytes not read yet."""
        return len(self._payload) - self._at

    def finish(self) -> None:
        """See that the message ends here, but for the padding that some writers add."""
        if self.remaining > _LONGEST_PADDING:
            raise MessageError("the message is longer than its type")
