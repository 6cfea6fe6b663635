# SPDX-License-Identifier: Apache-2.0
"""Where a vehicle is and how it moves, as far as path tracking needs to know."""

from __future__ import annotations

import math
from typing import NamedTuple

from runtime.models.rotations import wrapped


class Motion(NamedTuple):
    """Pose and motion of a vehicle whose front and rear wheels steer opposite.

    Attributes:
        x, y: of the centre, m, world.
        yaw: rad, world.
        speed: forward, m/s.
        angle: centre angle (of the equivalent bicycle's front wheel), rad, positive to the left.
        yaw_rate: rad/s.
    """

    x: float
    y: float
    yaw: float
    speed: float = 0.0
    angle: float = 0.0
    yaw_rate: float = 0.0

    def reversed(self) -> Motion:
        """The same seen from a driver who looks backwards: the rear wheels are then the front ones."""
        return Motion(self.x, self.y, wrapped(self.yaw + math.pi), -self.speed, -self.angle, self.yaw_rate)
