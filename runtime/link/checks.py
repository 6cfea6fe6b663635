# SPDX-License-Identifier: Apache-2.0
"""What a decoded message must be to be used."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from runtime.messages.errors import MessageError

_UNIT_TOLERANCE = 0.01


def check_frame(frame: str, accepted: Collection[str]) -> None:
    """See that a frame is one of those that are accepted; none listed means any.

    Raises:
        MessageError: if it is not.
    """
    if accepted and frame not in accepted:
        raise MessageError("the frame is not one that is accepted")


def check_finite(*numbers: float) -> None:
    """See that all numbers are finite.

    Raises:
        MessageError: if one is not.
    """
    if not all(map(math.isfinite, numbers)):
        raise MessageError("a number is not finite")


def unit_quaternion(parts: Sequence[float]) -> tuple[float, ...]:
    """A rotation with its length made exactly one.

    Raises:
        MessageError: if its length is far from one.
    """
    length = math.hypot(*parts)
    if not abs(length - 1.0) < _UNIT_TOLERANCE:
        raise MessageError("the orientation is no unit quaternion")
    return tuple(part / length for part in parts)
