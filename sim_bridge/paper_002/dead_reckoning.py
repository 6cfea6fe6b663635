# SPDX-License-Identifier: Apache-2.0
"""From a pose that is late to the present one, by the wheels: what the vehicle's filter does with a stamped pose."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

from runtime.tracking.motion import Motion


class DeadReckoning:
    """Carries a late pose on over what the wheels have done since.

    Args:
        age_s: of the pose, as its stamp tells.
        period_s: from one look at the wheels to the next; it divides the age.
    """

    def __init__(self, age_s: float, period_s: float) -> None:
        self._period_s = period_s
        self._looks = deque[tuple[float, float]](maxlen=round(age_s / period_s) + 1)

    def look(self, seen: Motion) -> None:
        """Take in speed and yaw rate of now; once a period, the first time at the start."""
        self._looks.append((seen.speed, seen.yaw_rate))

    def present(self, seen: Motion) -> Motion:
        """The motion now, from the late pose; the wheels of now must have been looked at."""
        x, y, yaw = seen[:3]
        for (speed, yaw_rate), (later, later_rate) in pairwise(self._looks):
            way, turned = 0.5 * self._period_s * (speed + later), 0.5 * self._period_s * (yaw_rate + later_rate)
            x, y = x + way * math.cos(yaw + 0.5 * turned), y + way * math.sin(yaw + 0.5 * turned)
            yaw += turned
        return seen._replace(x=x, y=y, yaw=yaw)
