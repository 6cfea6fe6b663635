# SPDX-License-Identifier: Apache-2.0
"""What a vehicle with four steered and driven wheels is made of.

Wheels are ordered front left, front right, rear left, rear right. The base frame lies at the vehicle's centre, on the
ground that the wheels stand on: x forward, y left. A steering angle is positive to the left, a wheel's speed positive
forward.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.models.quadruped import Link

Array = npt.NDArray[np.float64]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


class VehicleGeometry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Dimensions; the numbers are fitted to paper 002, Table II.

    Attributes:
        wheelbase_m: L, from the front to the rear wheels.
        track_m: B, from the left to the right wheels.
        wheel_radius_m: of each wheel.
        steering_range_rad: of each axis, to either side.
    """

    wheelbase_m: Positive = 1.17
    track_m: Positive = 0.74
    wheel_radius_m: Positive = 0.2
    steering_range_rad: Annotated[float, msgspec.Meta(gt=0.0, le=1.6)] = math.pi / 2.0

    @property
    def wheels(self) -> tuple[tuple[float, float], ...]:
        """Where the wheels meet the ground, in the base frame, (x, y), m."""
        x, y = self.wheelbase_m / 2.0, self.track_m / 2.0
        return (x, y), (x, -y), (-x, y), (-x, -y)

    def wheel_positions(self) -> Array:
        """The same as an array, (4, 2)."""
        return np.array(self.wheels)


class Vehicle(VehicleGeometry, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Dimensions and masses.

    Attributes:
        wheel_width_m, wheel_mass_kg: of each wheel, a cylinder.
        knuckle_mass_kg: what turns with a wheel about its steering axis, the wheel left out.
        chassis: all the rest, in the base frame.
        imu_height_m: of the IMU above the ground, over the vehicle's centre.
    """

    wheel_width_m: Positive
    wheel_mass_kg: Positive
    knuckle_mass_kg: Positive
    chassis: Link
    imu_height_m: Positive

    @property
    def mass_kg(self) -> float:
        """Total mass."""
        return self.chassis.mass_kg + len(WHEELS) * (self.wheel_mass_kg + self.knuckle_mass_kg)
