# SPDX-License-Identifier: Apache-2.0
"""What a vehicle with four steered and driven wheels is made of.

Wheels are ordered front left, front right, rear left, rear right. The base frame lies at the vehicle's centre, on the
ground that the wheels stand on: x forward, y left. A steering angle is positive to the left, a wheel's speed positive
forward.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.models.quadruped import Link

Array = npt.NDArray[np.float64]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
FORWARD = np.array([1.0, 1.0, -1.0, -1.0])
LEFT = np.array([1.0, -1.0, 1.0, -1.0])


class Vehicle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Geometry (fitted to paper 002, Table II) and masses.

    Attributes:
        wheelbase_m: L, from the front to the rear wheels.
        track_m: B, from the left to the right wheels.
        wheel_radius_m, wheel_width_m, wheel_mass_kg: of each wheel, a cylinder.
        knuckle_mass_kg: what turns with a wheel about its steering axis, the wheel left out.
        steering_range_rad: of each axis, to either side.
        chassis: all the rest, in the base frame.
        imu_height_m: of the IMU above the ground, over the vehicle's centre.
    """

    wheelbase_m: Positive
    track_m: Positive
    wheel_radius_m: Positive
    wheel_width_m: Positive
    wheel_mass_kg: Positive
    knuckle_mass_kg: Positive
    steering_range_rad: Annotated[float, msgspec.Meta(gt=0.0, le=1.6)]
    chassis: Link
    imu_height_m: Positive

    @property
    def mass_kg(self) -> float:
        """Total mass."""
        return self.chassis.mass_kg + len(WHEELS) * (self.wheel_mass_kg + self.knuckle_mass_kg)

    def wheel_positions(self) -> Array:
        """Where the wheels meet the ground, in the base frame, (4, 2), m."""
        return 0.5 * np.stack((FORWARD * self.wheelbase_m, LEFT * self.track_m), axis=1)
