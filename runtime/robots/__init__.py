# SPDX-License-Identifier: Apache-2.0
"""The robots, by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.errors import ConfigError, unknown

if TYPE_CHECKING:
    from runtime.robots.robot import Robot
    from runtime.robots.uslgo1.config import Uslgo1Config
    from runtime.tasks import Loop

ROBOTS = ("uslgo1",)
"""Names of the robots there are."""


def configuration_file(robot: str) -> Path:
    """The TOML file that comes with a robot.

    Raises:
        ConfigError: if there is no such robot.
    """
    if robot not in ROBOTS:
        raise ConfigError(unknown("robot", robot, ROBOTS))
    return Path(__file__).parent / robot / f"{robot}.toml"


def load_configuration(robot_or_file: str, overrides: Mapping[str, str] | None = None) -> Uslgo1Config:
    """The checked configuration of a robot, or of a TOML file like a robot's own."""
    from runtime.configuration import load
    from runtime.robots.uslgo1.config import Uslgo1Config

    is_file = robot_or_file.endswith(".toml") or "/" in robot_or_file
    path = Path(robot_or_file) if is_file else configuration_file(robot_or_file)
    return load(path, Uslgo1Config, overrides)


def assemble(robot: str, config_text: str, overrides: Mapping[str, str] | None = None) -> tuple[Loop, ...]:
    """The loops of a robot, from the resolved configuration in a log."""
    from runtime.configuration import loads
    from runtime.robots.uslgo1.assembly import assemble as assemble_uslgo1
    from runtime.robots.uslgo1.config import Uslgo1Config

    configuration_file(robot)
    return assemble_uslgo1(loads(config_text, Uslgo1Config, place="the log's configuration", overrides=overrides)).loops


def assembled(config: Uslgo1Config) -> Robot:
    """The robot that a configuration describes."""
    from runtime.robots.uslgo1.assembly import assemble as assemble_uslgo1

    return assemble_uslgo1(config)


def description(config: Uslgo1Config) -> str:
    """The robot that a configuration describes, as URDF."""
    from runtime.models.urdf import quadruped_urdf
    from runtime.safety.limits import joint_bounds

    safety, link = config.safety, config.link
    bounds = joint_bounds(safety)
    limits = safety.effort_max_nm, safety.velocity_max_radps
    return quadruped_urdf(config.quadruped, config.robot, link.base_frame, bounds, *limits)
