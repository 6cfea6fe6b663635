# SPDX-License-Identifier: Apache-2.0
"""Where a foot should land."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import msgspec

from runtime.compiled import compiled
from runtime.models.rigid_body import GRAVITY


class FootholdConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Foothold rule.

    Attributes:
        capture_gain: multiplies sqrt(h / g) times the velocity error (1 is the capture point of the inverted pendulum).
        reach_m: largest horizontal distance from the point below the shoulder.
    """

    capture_gain: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.7
    reach_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.4)] = 0.28


class TrunkMotion(NamedTuple):
    """What the foothold rule needs to know of the trunk, horizontal, in odom.

    Attributes:
        x, y: trunk origin, m.
        heading: rad.
        velocity_x, velocity_y: estimated, m/s.
        commanded_x, commanded_y: commanded velocity, m/s.
        yaw_rate: commanded, rad/s.
        height: of the trunk above the ground, m.
    """

    x: float
    y: float
    heading: float
    velocity_x: float
    velocity_y: float
    commanded_x: float
    commanded_y: float
    yaw_rate: float
    height: float


@compiled
def foothold(
    config: FootholdConfig,
    trunk: TrunkMotion,
    shoulder: tuple[float, float],
    remaining_s: float,
    stance_s: float,
) -> tuple[float, float]:
    """Horizontal foothold (x, y) in odom.

    The foot lands so that it is below its shoulder at mid-stance (Raibert's neutral point), displaced by the capture
    term.

    Args:
        config: parameters.
        trunk: its motion.
        shoulder: (x, y) of the point below which the foot stands at rest, in the base frame, m.
        remaining_s: time until the foot lands.
        stance_s: duration of the stance that follows.
    """
    cosine, sine = math.cos(trunk.heading), math.sin(trunk.heading)
    shoulder_x, shoulder_y = shoulder
    lever_x = cosine * shoulder_x - sine * shoulder_y
    lever_y = sine * shoulder_x + cosine * shoulder_y
    turned = trunk.yaw_rate * (remaining_s + 0.5 * stance_s)
    below_x = trunk.x + lever_x - turned * lever_y + remaining_s * trunk.velocity_x
    below_y = trunk.y + lever_y + turned * lever_x + remaining_s * trunk.velocity_y
    capture = config.capture_gain * math.sqrt(max(trunk.height, 0.0) / GRAVITY)
    step_x = 0.5 * stance_s * trunk.commanded_x + capture * (trunk.velocity_x - trunk.commanded_x)
    step_y = 0.5 * stance_s * trunk.commanded_y + capture * (trunk.velocity_y - trunk.commanded_y)
    length = math.hypot(step_x, step_y)
    scale = min(1.0, config.reach_m / length) if length > 0.0 else 1.0
    return below_x + scale * step_x, below_y + scale * step_y
