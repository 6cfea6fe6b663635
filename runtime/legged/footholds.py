# SPDX-License-Identifier: Apache-2.0
"""Where a foot should land."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class FootholdConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Foothold rule.

    Attributes:
        capture_gain: multiplies sqrt(h / g) times the velocity error (1 is the capture point of the inverted pendulum).
        stance_width_m: added to the lateral distance of each foot from its shoulder.
        reach_m: largest horizontal distance from the point below the shoulder.
    """

    capture_gain: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.7
    stance_width_m: Annotated[float, msgspec.Meta(ge=-0.05, le=0.1)] = 0.0
    reach_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.4)] = 0.28


def footholds(
    config: FootholdConfig,
    shoulder: Array,
    velocity: Array,
    velocity_commanded: Array,
    yaw_rate: float,
    center: Array,
    remaining_s: Array,
    stance_s: float,
    height_m: float,
    gravity: float,
) -> Array:
    """Horizontal footholds, (4, 2), in odom.

    The foot lands so that it is below its shoulder at mid-stance (Raibert's neutral point), displaced by the capture term.

    Args:
        config: parameters.
        shoulder: points below which the feet stand at rest, now, (4, 2).
        velocity, velocity_commanded: of the trunk, (2,), in odom.
        yaw_rate: commanded, rad/s.
        center: trunk origin, (2,).
        remaining_s: time until each foot lands, (4,).
        stance_s: duration of the stance that follows.
        height_m: of the trunk above the ground.
        gravity: m/s^2.
    """
    ahead = (remaining_s + 0.5 * stance_s)[:, None]
    lever = shoulder - center
    turned = lever + yaw_rate * ahead * np.stack((-lever[:, 1], lever[:, 0]), axis=1)
    below = center + turned + remaining_s[:, None] * velocity
    capture = config.capture_gain * np.sqrt(height_m / gravity) * (velocity - velocity_commanded)
    step = 0.5 * stance_s * velocity_commanded + capture
    return below + step * min(1.0, config.reach_m / max(float(np.hypot(step[0], step[1])), 1e-9))
