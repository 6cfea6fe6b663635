# SPDX-License-Identifier: Apache-2.0
"""How fast to go: small functions, one consideration each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import Meta


class SpeedLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of the speed along the path.

    Attributes:
        maximum_mps: commanded speeds above it are cut.
        acceleration_mps2: of the ramp up.
        deceleration_mps2: of the ramp down, and of the approach to the goal.
        lateral_acceleration_mps2: bound on v^2 times curvature.
        maximum_yaw_rate_radps: bound on v times curvature.
        yaw_acceleration_radps2: bound on the change of the yaw rate.
        approach_per_s: speed per remaining distance, close to the goal.
        approach_minimum_mps: slowest approach.
        goal_tolerance_m: remaining arc length at which to stop.
    """

    maximum_mps: Annotated[float, Meta(gt=0.0, le=5.0)] = 2.0
    acceleration_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.5
    deceleration_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.6
    lateral_acceleration_mps2: Annotated[float, Meta(gt=0.0, le=20.0)] = 0.6
    maximum_yaw_rate_radps: Annotated[float, Meta(gt=0.0, le=5.0)] = 1.0
    yaw_acceleration_radps2: Annotated[float, Meta(gt=0.0, le=50.0)] = 3.0
    approach_per_s: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.0
    approach_minimum_mps: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.06
    goal_tolerance_m: Annotated[float, Meta(gt=0.0, le=0.15)] = 0.03

    def with_grip(self, share: float) -> SpeedLimits:
        """The same where the ground bears only a share of the accelerations, 0 to 1."""
        if share >= 1.0:
            return self
        return msgspec.structs.replace(
            self,
            acceleration_mps2=share * self.acceleration_mps2,
            deceleration_mps2=share * self.deceleration_mps2,
            lateral_acceleration_mps2=share * self.lateral_acceleration_mps2,
        )


class TrimmedSpeed(SpeedLimits, frozen=True, forbid_unknown_fields=True):
    """Limits of the speed of a robot that lags behind its command and does not quite reach it.

    Attributes:
        lead_mps: how far the command may run ahead of the measured speed.
        trim_per_s: rate at which the trim takes up a relative deficit of speed; 0 switches it off.
        trim_maximum: bound on the trim, as a share of the speed.
    """

    lead_mps: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.4
    trim_per_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.5
    trim_maximum: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.15


def regulated_speed(wanted: float, curvature: float, limits: SpeedLimits) -> float:
    """The wanted speed, m/s, or less where the curvature (1/m) asks for too much lateral acceleration or yaw rate."""
    bend = abs(curvature)
    if bend < 1e-9:
        return min(wanted, limits.maximum_mps)
    by_acceleration = math.sqrt(limits.lateral_acceleration_mps2 / bend)
    return min(wanted, limits.maximum_mps, by_acceleration, limits.maximum_yaw_rate_radps / bend)


def approach_speed(wanted: float, remaining: float, limits: SpeedLimits) -> float:
    """The wanted speed, m/s, or less where the goal is near (remaining arc length in m)."""
    if remaining <= limits.goal_tolerance_m:
        return 0.0
    braking = math.sqrt(2.0 * limits.deceleration_mps2 * remaining)
    return min(wanted, max(min(braking, limits.approach_per_s * remaining), limits.approach_minimum_mps))


def ramped(previous: float, wanted: float, acceleration: float, deceleration: float, dt: float) -> float:
    """One step towards the wanted value (speed or yaw rate), no faster than the limits per second."""
    return min(max(wanted, previous - deceleration * dt), previous + acceleration * dt)


def surface_stretch(normal: Sequence[float], heading: float) -> float:
    """Length along the stance plane per horizontal length, in the direction of the heading.

    Args:
        normal: unit normal of the stance plane, world.
        heading: rad.

    Returns:
        1 on the level, 1 / cos(slope) up or down a slope; at most 2.
    """
    if not normal[2] > 0.1:
        return 1.0
    grade = -(normal[0] * math.cos(heading) + normal[1] * math.sin(heading)) / normal[2]
    return min(math.sqrt(1.0 + grade * grade), 2.0)


def next_trim(trim: float, commanded: float, travelled: float, dt: float, limits: TrimmedSpeed) -> float:
    """The speed trim after one step.

    An integral of commanded minus travelled distance. Being on distance, it telescopes to the position: neither a
    scale error of a measured velocity nor white noise of the position biases it.

    Args:
        trim: previous share added to the speed.
        commanded: speed along the surface, m/s.
        travelled: distance along the surface in this step, m.
        dt: s.
        limits: the limits.
    """
    change = limits.trim_per_s * (commanded * dt - travelled) / commanded
    return min(max(trim + change, -limits.trim_maximum), limits.trim_maximum)
