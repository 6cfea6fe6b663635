# SPDX-License-Identifier: Apache-2.0
"""How fast a path may be driven for the bends that are ahead."""

from __future__ import annotations

import math
from typing import Annotated, Protocol

import msgspec
from msgspec import Meta

from runtime.tracking.curvature import mean_curvature
from runtime.tracking.polyline import Polyline
from runtime.tracking.speed import SpeedLimits, approach_speed, regulated_speed

BRAKING_SHARE = 0.7
"""Share of the deceleration that is counted on, so that the ramp of the speed can follow."""


def bend_speed(path: Polyline, progress: float, wanted: float, limits: SpeedLimits, span_m: float) -> float:
    """The wanted speed, m/s, or less, so that the limits hold here and, with the deceleration allowed, ahead.

    Ahead, the path is looked at from span to span, so that no bend lies in between.

    Args:
        path: the path.
        progress: arc length of the vehicle, m.
        wanted: m/s, positive.
        limits: the limits.
        span_m: length over which the path's curvature is taken.
    """
    allowed = regulated_speed(wanted, mean_curvature(path, progress, span_m), limits)
    braking = BRAKING_SHARE * limits.deceleration_mps2
    reach = 0.5 * allowed * allowed / braking + span_m
    for station in range(1, math.ceil(reach / span_m) + 1):
        way = station * span_m
        there = regulated_speed(wanted, mean_curvature(path, progress + way, span_m), limits)
        allowed = min(allowed, math.sqrt(there * there + 2.0 * braking * way))
    return allowed


class SpeedPolicy(Protocol):
    """How fast to drive."""

    def __call__(
        self, path: Polyline, curvature: float, progress: float, remaining: float, wanted: float, grip: float = 1.0
    ) -> float:
        """The speed, m/s.

        Args:
            path: the path.
            curvature: of the arc that is to be driven, 1/m.
            progress: arc length of the vehicle, m.
            remaining: arc length to where the vehicle is to stop, m.
            wanted: m/s, positive.
            grip: share of the accelerations that may be counted on, 0 to 1.
        """


class PathSpeed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As fast as the bends of the path, the arc that is driven and the goal allow.

    Attributes:
        limits: the limits.
        span_m: length over which the path's curvature is taken.
    """

    limits: SpeedLimits
    span_m: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.6

    def __call__(
        self, path: Polyline, curvature: float, progress: float, remaining: float, wanted: float, grip: float = 1.0
    ) -> float:
        """The speed, m/s."""
        limits = self.limits.with_grip(grip)
        allowed = bend_speed(path, progress, wanted, limits, self.span_m)
        return approach_speed(regulated_speed(allowed, curvature, limits), remaining, limits)
