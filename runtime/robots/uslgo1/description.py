# SPDX-License-Identifier: Apache-2.0
"""USLGO1 as URDF."""

from __future__ import annotations

from runtime.models.urdf import quadruped_urdf
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.safety.limits import joint_bounds


def description(config: Uslgo1Config) -> str:
    """The robot that a configuration describes, as URDF."""
    safety, link = config.safety, config.link
    bounds = joint_bounds(safety)
    limits = safety.effort_max_nm, safety.velocity_max_radps
    return quadruped_urdf(config.quadruped, config.robot, link.base_frame, bounds, *limits)
