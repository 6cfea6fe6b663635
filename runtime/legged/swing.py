# SPDX-License-Identifier: Apache-2.0
"""The path of a foot through the air."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class SwingConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Shape of the swing.

    Attributes:
        height_m: apex above the higher of lift-off and foothold.
        touchdown_speed_mps: downward speed at the foothold, kept up until contact when the ground comes late.
        reach_below_m: how far below the foothold a foot searches for late ground.
    """

    height_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.2)] = 0.08
    touchdown_speed_mps: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.2
    reach_below_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.06


class FootReference(NamedTuple):
    """Position, velocity and acceleration references of one foot, (3,) each, in odom."""

    position: Array
    velocity: Array
    acceleration: Array


def _quintic(begin: float, end: float, end_rate: float, s: float) -> tuple[float, float, float]:
    """Quintic from rest at `begin` to `end` with a final rate and no final curvature: value, rate, curvature at s in [0, 1]."""
    rise = end - begin
    a3, a4, a5 = 10 * rise - 4 * end_rate, -15 * rise + 7 * end_rate, 6 * rise - 3 * end_rate
    return (
        begin + s**3 * (a3 + s * (a4 + s * a5)),
        s**2 * (3 * a3 + s * (4 * a4 + s * 5 * a5)),
        s * (6 * a3 + s * (12 * a4 + s * 20 * a5)),
    )


def foot_reference(
    config: SwingConfig, lift_off: Array, foothold: Array, normal: Array, progress: float, duration_s: float
) -> FootReference:
    """The reference at `progress` (1 at the scheduled touchdown, more when the ground comes late).

    Horizontal motion is minimum-jerk; the height along `normal` rises to the apex at mid-swing and comes down to meet the
    foothold at the touchdown speed.
    """
    travel = foothold - lift_off
    if progress >= 1.0:
        depth = min(config.touchdown_speed_mps * (progress - 1.0) * duration_s, config.reach_below_m)
        moving = depth < config.reach_below_m
        speed = config.touchdown_speed_mps if moving else 0.0
        return FootReference(foothold - normal * depth, -normal * speed, np.zeros(3))
    s, ds, dds = _quintic(0.0, 1.0, 0.0, progress)
    rise = float(travel @ normal)
    apex = max(rise, 0.0) + config.height_m
    half = 0.5 * duration_s
    if progress < 0.5:
        z, dz, ddz = _quintic(0.0, apex, 0.0, 2 * progress)
    else:
        z, dz, ddz = _quintic(apex, rise, -config.touchdown_speed_mps * half, 2 * progress - 1)
    along = travel - rise * normal
    return FootReference(
        lift_off + s * along + z * normal,
        (ds / duration_s) * along + (dz / half) * normal,
        (dds / duration_s**2) * along + (ddz / half**2) * normal,
    )
