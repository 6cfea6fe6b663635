# SPDX-License-Identifier: Apache-2.0
"""How much of the grip that is counted on the ground still gives, judged by how the vehicle slides.

Without side slip the centre of a vehicle with dual Ackermann steering moves straight ahead, and its wheels roll as fast
as they move. Where it does otherwise while something is asked of the ground, the accelerations that are counted on fall
at a steady rate, and come back at a lower one when it no longer does: what passes quickly, as noise does, changes
little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

Rate = Annotated[float, Meta(gt=0.0, le=20.0)]


class TractionConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a vehicle slides, and what it then does.

    Attributes:
        lateral_mps: it slides when its centre moves faster than this across its heading,
        lateral_share: and than this share of its forward speed,
        lateral_mps2: while it is asked for a greater lateral acceleration than this; asked for less it keeps its hold,
            and what looks like side slip is rough ground;
        rolling_mps: or when the slip of two of its wheels is so much of its speed (at little speed, slip is noise).
        least: share of the accelerations that is counted on at least.
        fall_per_s: how fast the share falls while it slides,
        rise_per_s: and rises again when it does not.
    """

    lateral_mps: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.05
    lateral_share: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.02
    lateral_mps2: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.5
    rolling_mps: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.3
    least: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.25
    fall_per_s: Rate = 1.5
    rise_per_s: Rate = 0.1

    def __post_init__(self) -> None:
        """Check the rates against each other.

        Raises:
            ValueError: if grip would come back faster than it goes.
        """
        if self.rise_per_s > self.fall_per_s:
            raise ValueError(f"rise_per_s = {self.rise_per_s} is above fall_per_s = {self.fall_per_s}")


def slides(velocity: Sequence[float], slip: Sequence[float], asked_mps2: float, config: TractionConfig) -> bool:
    """Whether a vehicle slides that is steered as dual Ackermann steering is.

    Args:
        velocity: forward and lateral, of its centre, m/s.
        slip: ratio of each wheel, of the larger of its rolling speed and its speed over the ground.
        asked_mps2: lateral acceleration that it is asked for.
        config: the bounds.
    """
    forward, lateral = velocity
    across = abs(lateral) > max(config.lateral_mps, config.lateral_share * abs(forward))
    if across and abs(asked_mps2) > config.lateral_mps2:
        return True
    second = sorted(map(abs, slip))[-2]
    return second * math.hypot(forward, lateral) > config.rolling_mps


def next_lost(lost: float, sliding: bool, dt: float, config: TractionConfig) -> float:
    """The share of the accelerations that is not counted on, after one step of dt seconds."""
    if sliding:
        return min(lost + config.fall_per_s * dt, 1.0 - config.least)
    return max(lost - config.rise_per_s * dt, 0.0)
