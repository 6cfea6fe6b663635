# SPDX-License-Identifier: Apache-2.0
"""Whether a vehicle's wheels are asked for no more than safety promises, in the command and where it arrives."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.vehicle_signals import WheelCommand

Array = npt.NDArray[np.float64]
ROUNDING = 1e-9
"""Of sums of steps."""


class WheelLimits:
    """Angles and speeds, and by how much a driven wheel's may change from one command to the next.

    Args:
        config: of the vehicle.
    """

    def __init__(self, config: Vehicle4ws4wdConfig) -> None:
        safety, radius, step_s = config.safety, config.vehicle.wheel_radius_m, config.loops.drive_period_ns * 1e-9
        ranges = config.drives.unit().database.commands[1].ranges
        resolution = np.array([[ranges["SteeringCommand"].resolution], [ranges["SpeedCommand"].resolution]])
        self._largest = np.array([[safety.steering_max_rad], [safety.speed_max_mps / radius]])
        self._arrived = self._largest + 0.5 * resolution + ROUNDING
        fastest_mps2 = max(safety.acceleration_max_mps2, safety.halt_mps2, safety.brake_mps2)
        steps = np.array([[safety.steering_rate_max_radps], [fastest_mps2 / radius]])
        self._steps = steps * step_s + ROUNDING
        self._before: Array | None = None

    def kept(self, command: WheelCommand, arrived: Array) -> bool:
        """Whether a command is within them, and what the control unit took of those before it.

        Args:
            command: after that of the last call.
            arrived: (2, 4) angles (rad) and speeds (rad/s).
        """
        asked = np.stack((command.steering, command.speed))
        kept = (np.abs(asked) <= self._largest + ROUNDING).all() and (np.abs(arrived) <= self._arrived).all()
        if command.enable and self._before is not None:
            kept = kept and (np.abs(asked - self._before) <= self._steps).all()
        self._before = asked if command.enable else None
        return bool(kept)
