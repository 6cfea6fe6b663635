# SPDX-License-Identifier: Apache-2.0
"""Following a velocity that the operator asks for, instead of a path."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from runtime.signals import OperatorRequest
from runtime.tracking.speed import SpeedLimits, ramped

Speed = Annotated[float, Meta(ge=0.0, le=5.0)]


class VelocityLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of the velocity that is asked for; those of a path's speed hold too.

    Attributes:
        forward_mps, backward_mps, lateral_mps: largest speeds.
        age_max_ns: an older request is taken for one to stand.
    """

    forward_mps: Speed = 0.6
    backward_mps: Speed = 0.3
    lateral_mps: Speed = 0.2
    age_max_ns: Annotated[int, Meta(gt=0, le=5_000_000_000)] = 500_000_000


class PlanarVelocity(NamedTuple):
    """Forward and lateral, m/s, and yaw rate, rad/s."""

    forward: float
    lateral: float
    yaw_rate: float


REST = PlanarVelocity(0.0, 0.0, 0.0)


def wanted_velocity(
    request: OperatorRequest, now_ns: int, limits: VelocityLimits, speed_limits: SpeedLimits
) -> PlanarVelocity:
    """What the operator asks for, within the limits; rest if that was too long ago."""
    if now_ns - request.velocity_ns > limits.age_max_ns:
        return REST
    forward, lateral, yaw_rate = request.velocity.tolist()
    forward = min(max(forward, -limits.backward_mps), limits.forward_mps, speed_limits.maximum_mps)
    lateral = min(max(lateral, -limits.lateral_mps), limits.lateral_mps)
    bound = speed_limits.maximum_yaw_rate_radps
    if forward:
        bound = min(bound, speed_limits.lateral_acceleration_mps2 / abs(forward))
    return PlanarVelocity(forward, lateral, min(max(yaw_rate, -bound), bound))


def approached(present: PlanarVelocity, wanted: PlanarVelocity, limits: SpeedLimits, dt: float) -> PlanarVelocity:
    """One step towards the wanted velocity."""
    up, down, turn = limits.acceleration_mps2, limits.deceleration_mps2, limits.yaw_acceleration_radps2
    return PlanarVelocity(
        ramped(present.forward, wanted.forward, up, down, dt),
        ramped(present.lateral, wanted.lateral, up, down, dt),
        ramped(present.yaw_rate, wanted.yaw_rate, turn, turn, dt),
    )
