# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/Imu from an inertial sample."""

from __future__ import annotations

from runtime.messages.cdr import CdrTemplate
from runtime.signals import Imu

_UNKNOWN = -1.0
"""First covariance element of a quantity that the sensor does not give (the message's own convention)."""


class ImuMessage:
    """Encodes /imu/data.

    The sensor gives no orientation: its covariance says so. The other covariances stay zero, which means unknown.
    """

    def __init__(self, frame: str = "imu_link") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        orientation, orientation_covariance = template.float64(4), template.float64(9)
        angular_velocity, _ = template.float64(3), template.float64(9)
        linear_acceleration, _ = template.float64(3), template.float64(9)
        template.view(orientation, 4)[3] = 1.0
        template.view(orientation_covariance, 9)[0] = _UNKNOWN
        self._angular_velocity = template.view(angular_velocity, 3)
        self._linear_acceleration = template.view(linear_acceleration, 3)

    def encode(self, imu: Imu) -> bytes:
        """The message of one sample."""
        self._template.set_stamp(self._stamp, imu.stamp_ns)
        self._angular_velocity[:] = imu.angular_velocity
        self._linear_acceleration[:] = imu.linear_acceleration
        return self._template.to_bytes()
