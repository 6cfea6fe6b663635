# SPDX-License-Identifier: Apache-2.0
"""What the wheels do together, as one number each; of commands and of measurements alike."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def centre_angle(steering: Array) -> float:
    """Steering angle of the bicycle that front and rear wheels together make, about, rad."""
    front_left, front_right, rear_left, rear_right = steering.tolist()
    return 0.25 * float(front_left + front_right - rear_left - rear_right)


def rolling_speed(speed: Array, wheel_radius_m: float) -> float:
    """Mean rolling speed of the wheels, m/s."""
    return wheel_radius_m * sum(speed.tolist()) / speed.size
