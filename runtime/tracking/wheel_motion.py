# SPDX-License-Identifier: Apache-2.0
"""What the wheels do together, as one number each; of commands and of measurements alike."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.models.dual_ackermann import wheel_centre_angle
from runtime.models.vehicle import VehicleGeometry

Array = npt.NDArray[np.float64]


def centre_angle(steering: Array, geometry: VehicleGeometry) -> float:
    """Steering angle of the bicycle that front and rear wheels together make, rad: the mean of what each wheel says.

    In dual Ackermann steering all say the same, as long as no wheel has come round by half a turn (the radius is above
    half the track). Sideways and turning in place they cancel: that is no arc, and straight for the bicycle.
    """
    said = [
        wheel_centre_angle(angle if x > 0.0 else -angle, y, geometry.wheelbase_m)
        for angle, (x, y) in zip(steering.tolist(), geometry.wheels, strict=True)
    ]
    return sum(said) / len(said)


def rolling_speed(speed: Array, wheel_radius_m: float) -> float:
    """Mean rolling speed of the wheels, m/s."""
    return wheel_radius_m * sum(speed.tolist()) / speed.size
