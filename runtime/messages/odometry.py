# SPDX-License-Identifier: Apache-2.0
"""nav_msgs/Odometry from the estimate of the robot."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.messages.cdr import CdrTemplate
from runtime.signals import BodyState
from runtime.vehicle_signals import VehicleState


def in_body_frame(orientation: npt.NDArray[np.float64], vector: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """A vector of the parent frame expressed in the frame that the quaternion (x, y, z, w) turns to."""
    x, y, z, w = orientation.tolist()
    a, b, c = vector.tolist()
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (
        a + w * tx + ty * z - tz * y,
        b + w * ty + tz * x - tx * z,
        c + w * tz + tx * y - ty * x,
    )


class OdometryMessage:
    """Encodes /odom: pose in `odom`, twist in the robot's own frame, covariances unknown (zero)."""

    def __init__(self, frame: str = "odom", child_frame: str = "base_link") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        template.string(child_frame)
        position, orientation, _ = template.float64(3), template.float64(4), template.float64(36)
        linear, angular, _ = template.float64(3), template.float64(3), template.float64(36)
        self._position, self._orientation = template.view(position, 3), template.view(orientation, 4)
        self._linear, self._angular = template.view(linear, 3), template.view(angular, 3)

    def encode(self, body: BodyState | VehicleState) -> bytes:
        """The message of one estimate."""
        self._template.set_stamp(self._stamp, body.stamp_ns)
        self._position[:] = body.position
        self._orientation[:] = body.orientation
        self._linear[:] = in_body_frame(body.orientation, body.linear_velocity)
        self._angular[:] = body.angular_velocity
        return self._template.to_bytes()
