# SPDX-License-Identifier: Apache-2.0
"""Turning in place."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta


class TurnLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When and how to turn in place.

    Attributes:
        start_rad: bearing of the target above which the robot stops and turns first.
        stop_rad: bearing below which it walks on.
        gain_per_s: turn rate per heading error, close to the aim.
        maximum_radps: greatest turn rate.
        deceleration_radps2: the turn rate never exceeds what this can still stop.
    """

    start_rad: Annotated[float, Meta(ge=0.2, le=3.2)] = math.radians(60.0)
    stop_rad: Annotated[float, Meta(ge=0.01, le=1.0)] = math.radians(8.0)
    gain_per_s: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.5
    maximum_radps: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.8
    deceleration_radps2: Annotated[float, Meta(gt=0.0, le=20.0)] = 1.5

    def __post_init__(self) -> None:
        """Check the bounds against each other.

        Raises:
            ValueError: if turning would stop before it starts.
        """
        if self.stop_rad >= self.start_rad:
            raise ValueError(f"stop_rad = {self.stop_rad} is not below start_rad = {self.start_rad}")


def turn_rate(heading_error: float, limits: TurnLimits) -> float:
    """Yaw rate that takes a heading error to zero without overshoot, rad/s.

    Args:
        heading_error: aim minus heading, rad; its sign is that of the result.
        limits: the limits.
    """
    size = abs(heading_error)
    rate = min(limits.gain_per_s * size, limits.maximum_radps, math.sqrt(2.0 * limits.deceleration_radps2 * size))
    return math.copysign(rate, heading_error)


def needs_turn(turning: bool, heading_error: float, limits: TurnLimits) -> bool:
    """Whether to turn in place, with hysteresis."""
    return abs(heading_error) > (limits.stop_rad if turning else limits.start_rad)
