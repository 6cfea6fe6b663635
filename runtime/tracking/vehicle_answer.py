# SPDX-License-Identifier: Apache-2.0
"""How a vehicle answers a command: no faster than it can."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.models.dual_ackermann import centre_angle, centre_curvature


class VehicleAnswer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A first-order lag and a rate limit on the centre angle, and a rate limit on the speed.

    Attributes:
        wheelbase_m: L.
        rate_radps: greatest rate of the centre angle.
        lag_s: time constant of the centre angle.
        acceleration_mps2: greatest rate of the speed.
    """

    wheelbase_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.17
    rate_radps: Annotated[float, Meta(gt=0.0, le=20.0)] = math.radians(20.0)
    lag_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    acceleration_mps2: Annotated[float, Meta(gt=0.0, le=20.0)] = 2.0

    def angle_of(self, curvature: float) -> float:
        """Centre angle for a curvature of the centre's path."""
        return centre_angle(curvature, self.wheelbase_m)

    def curvature_of(self, angle: float) -> float:
        """Curvature of the centre's path at a centre angle, 1/m."""
        return centre_curvature(angle, self.wheelbase_m)

    def slewed(self, curvature: float, wanted: float, time_s: float) -> float:
        """The wanted curvature, or as much of the way to it as the steering can turn in this time."""
        present, target = self.angle_of(curvature), self.angle_of(wanted)
        most = self.rate_radps * time_s
        if abs(target - present) <= most:
            return wanted
        return self.curvature_of(present + math.copysign(most, target - present))
