# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/Imu: inertial samples."""

from __future__ import annotations

from typing import NamedTuple

from runtime.messages.cdr import CdrTemplate
from runtime.messages.cdr_reader import CdrReader
from runtime.signals import Imu

_UNKNOWN = -1.0
"""First covariance element of a quantity that the sensor does not give (the message's own convention)."""


class InertialSample(NamedTuple):
    """What is used of an inertial sample.

    Attributes:
        stamp_ns: of the header.
        frame: of the sensor.
        angular_velocity: x, y, z, rad/s.
        linear_acceleration: specific force, x, y, z, m/s^2.
    """

    stamp_ns: int
    frame: str
    angular_velocity: tuple[float, ...]
    linear_acceleration: tuple[float, ...]


def decode_imu(payload: bytes) -> InertialSample:
    """A sensor_msgs/Imu; MessageError if it is none."""
    reader = CdrReader(payload)
    stamp_ns, frame = reader.header()
    values = reader.numbers("d", 4 + 9 + 3 + 9 + 3 + 9)
    reader.finish()
    return InertialSample(stamp_ns, frame, values[13:16], values[25:28])


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
