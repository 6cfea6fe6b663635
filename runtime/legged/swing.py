# SPDX-License-Identifier: Apache-2.0
"""The path of a foot through the air."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.models.vectors import dot

Array = npt.NDArray[np.float64]


class SwingConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Shape of the swing.

    Attributes:
        height_m: apex above the higher of lift-off and foothold.
        touchdown_speed_mps: downward speed at the foothold.
        search_speed_mps: downward speed of a foot that searches for late ground.
        reach_below_m: how far below the foothold it searches.
    """

    height_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.2)] = 0.08
    touchdown_speed_mps: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.2
    search_speed_mps: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 0.5
    reach_below_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.1


@compiled
def _quintic(begin: float, end: float, end_rate: float, s: float) -> tuple[float, float, float]:
    """Value, rate and curvature at s in [0, 1] of the quintic from rest at `begin` to `end` with a final rate."""
    rise = end - begin
    a3, a4, a5 = 10 * rise - 4 * end_rate, -15 * rise + 7 * end_rate, 6 * rise - 3 * end_rate
    return (
        begin + s**3 * (a3 + s * (a4 + s * a5)),
        s**2 * (3 * a3 + s * (4 * a4 + s * 5 * a5)),
        s * (6 * a3 + s * (12 * a4 + s * 20 * a5)),
    )


@compiled
def foot_reference(
    config: SwingConfig, lift_off: Array, foothold: Array, normal: Array, progress: float, duration_s: float
) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration references (3,) each of a foot, in odom.

    Along the ground the motion is minimum-jerk; the height along `normal` rises to the apex at mid-swing and comes down
    to meet the foothold at the touchdown speed.

    Args:
        config: shape.
        lift_off: foot centre at the begin, m.
        foothold: foot centre at the end, m.
        normal: of the ground.
        progress: 0 at lift-off, 1 at the scheduled touchdown, more when the ground comes late.
        duration_s: of the swing.
    """
    if progress >= 1.0:
        return _search(config, foothold, normal, (progress - 1.0) * duration_s)
    s, ds, dds = _quintic(0.0, 1.0, 0.0, progress)
    ds, dds = ds / duration_s, dds / duration_s**2
    travel = foothold - lift_off
    rise = dot(travel, normal)
    apex = max(rise, 0.0) + config.height_m
    half = 0.5 * duration_s
    if progress < 0.5:
        z, dz, ddz = _quintic(0.0, apex, 0.0, 2 * progress)
    else:
        z, dz, ddz = _quintic(apex, rise, -config.touchdown_speed_mps * half, 2 * progress - 1)
    dz, ddz = dz / half, ddz / half**2
    along = travel - rise * normal
    return lift_off + s * along + z * normal, ds * along + dz * normal, dds * along + ddz * normal


@compiled
def _search(config: SwingConfig, foothold: Array, normal: Array, late_s: float) -> tuple[Array, Array, Array]:
    """The ground is late: go on downwards, and hold at the end of the reach."""
    depth = min(config.search_speed_mps * late_s, config.reach_below_m)
    speed = config.search_speed_mps if depth < config.reach_below_m else 0.0
    return foothold - depth * normal, -speed * normal, np.zeros(3)
