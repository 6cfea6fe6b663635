# SPDX-License-Identifier: Apache-2.0
"""The vehicle as URDF."""

from __future__ import annotations

from runtime.models.vehicle_urdf import vehicle_urdf
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig


def description(config: Vehicle4ws4wdConfig) -> str:
    """The vehicle that a configuration describes, as URDF."""
    fastest = config.steering.maximum_wheel_radps
    return vehicle_urdf(config.vehicle, config.robot, config.link.base_frame, fastest)
