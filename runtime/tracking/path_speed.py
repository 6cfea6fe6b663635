# SPDX-License-Identifier: Apache-2.0
"""How fast a path may be driven for the bends that are ahead."""

from __future__ import annotations

import math
from typing import Annotated, Protocol

import msgspec
from msgspec import Meta

from runtime.tracking.curvature import curvatures_ahead
from runtime.tracking.polyline import Polyline
from runtime.tracking.speed import SpeedLimits, approach_speed, regulated_speed
from runtime.tracking.vehicle_answer import VehicleAnswer

BRAKING_SHARE = 0.7
"""Share of the deceleration that is counted on, so that the ramp of the speed can follow."""


def steering_speed(wanted: float, before: float, after: float, way_m: float, answer: VehicleAnswer) -> float:
    """The wanted speed, m/s, or less, so that the steering can turn as fast as the path's curvature changes.

    Args:
        wanted: m/s, positive.
        before: curvature, 1/m.
        after: the same, further along the path.
        way_m: between the two.
        answer: of the steering.
    """
    turn_rad = abs(answer.angle_of(after) - answer.angle_of(before))
    within_s = turn_rad / answer.rate_radps
    return wanted if wanted * within_s <= way_m else way_m / within_s


def bend_speed(
    path: Polyline, progress: float, wanted: float, limits: SpeedLimits, span_m: float, answer: VehicleAnswer
) -> float:
    """The wanted speed, m/s, or less, so that the limits hold here and, with the deceleration allowed, ahead.

    Ahead, the path is looked at from half a span to the next, so that no bend, and no change of one, lies in between.

    Args:
        path: the path.
        progress: arc length of the vehicle, m.
        wanted: m/s, positive.
        limits: the limits.
        span_m: length over which the path's curvature is taken.
        answer: of the steering.
    """
    step_m = 0.5 * span_m
    braking = BRAKING_SHARE * limits.deceleration_mps2
    reach = 0.5 * min(wanted, limits.maximum_mps) ** 2 / braking + span_m
    count = math.ceil(reach / step_m) + 1
    curvatures = curvatures_ahead(path, progress - step_m, step_m, count + 2, span_m)
    allowed = wanted
    for station, (before, here, after) in enumerate(zip(curvatures, curvatures[1:], curvatures[2:], strict=False)):
        there = steering_speed(regulated_speed(wanted, here, limits), before, after, span_m, answer)
        allowed = min(allowed, math.sqrt(there * there + 2.0 * braking * station * step_m))
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
    """As fast as the bends of the path, the steering into them, the arc that is driven and the goal allow.

    Attributes:
        limits: the limits.
        answer: of the steering.
        span_m: length over which the path's curvature is taken.
    """

    limits: SpeedLimits
    answer: VehicleAnswer
    span_m: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.6

    def __call__(
        self, path: Polyline, curvature: float, progress: float, remaining: float, wanted: float, grip: float = 1.0
    ) -> float:
        """The speed, m/s."""
        limits = self.limits.with_grip(grip)
        allowed = bend_speed(path, progress, wanted, limits, self.span_m, self.answer)
        return approach_speed(regulated_speed(allowed, curvature, limits), remaining, limits)
