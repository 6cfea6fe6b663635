# SPDX-License-Identifier: Apache-2.0
"""Where the wheels of a four-wheel vehicle are. Their order is front left, front right, rear left, rear right."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

Length = Annotated[float, Meta(gt=0.0, le=10.0)]


class VehicleGeometry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Dimensions of the vehicle (paper 002; the numbers are fitted to its Table II).

    Attributes:
        wheelbase_m: L, between the axles.
        track_m: B, between left and right.
        wheel_radius_m: of each wheel.
        steering_limit_rad: greatest steering angle to either side.
    """

    wheelbase_m: Length = 1.17
    track_m: Length = 0.74
    wheel_radius_m: Length = 0.2
    steering_limit_rad: Annotated[float, Meta(gt=0.0, le=math.pi)] = math.pi / 2.0

    @property
    def wheels(self) -> tuple[tuple[float, float], ...]:
        """Wheel positions (x, y) from the vehicle's centre, m."""
        x, y = self.wheelbase_m / 2.0, self.track_m / 2.0
        return (x, y), (x, -y), (-x, y), (-x, -y)


def centre_angle(curvature: float, wheelbase_m: float) -> float:
    """Steering angle of the front centre wheel of the equivalent bicycle, rad: tan(delta) = L kappa / 2."""
    return math.atan(0.5 * wheelbase_m * curvature)


def centre_curvature(angle: float, wheelbase_m: float) -> float:
    """Curvature of the centre's path at a centre angle, 1/m; the rear wheels steer opposite."""
    return 2.0 * math.tan(angle) / wheelbase_m


def inner_angle(curvature: float, geometry: VehicleGeometry) -> float:
    """Steering angle of the front inner wheel in dual Ackermann steering, rad, positive (eq 1)."""
    bend = abs(curvature)
    return math.atan2(geometry.wheelbase_m * bend, 2.0 - geometry.track_m * bend)
