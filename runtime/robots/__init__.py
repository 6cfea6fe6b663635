# SPDX-License-Identifier: Apache-2.0
"""The robots, by name.

A robot is a folder with its TOML and four modules: `config` (`CONFIG`, the schema of the TOML), `assembly` (`assemble`,
its tasks in loops), `description` (`description`, its URDF) and `rehearsal` (`rehearse`, so that nothing is used for
the first time when it counts). They are imported when they are needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import ConfigError, unknown

if TYPE_CHECKING:
    from runtime.robots.robot import Robot
    from runtime.robots.robot_config import RobotConfig
    from runtime.tasks import Loop

_FOLDERS = {"uslgo1": "uslgo1", "4ws4wd": "vehicle_4ws4wd"}
ROBOTS = tuple(_FOLDERS)
"""Names of the robots there are."""


def configuration_file(robot: str) -> Path:
    """The TOML file that comes with a robot.

    Raises:
        ConfigError: if there is no such robot.
    """
    if robot not in ROBOTS:
        raise ConfigError(unknown("robot", robot, ROBOTS))
    return Path(__file__).parent / _FOLDERS[robot] / f"{robot}.toml"


def load_configuration(robot_or_file: str, overrides: Mapping[str, str] | None = None) -> RobotConfig:
    """The checked configuration of a robot, or of a TOML file like a robot's own."""
    from runtime.configuration import loads, read

    is_file = robot_or_file.endswith(".toml") or "/" in robot_or_file
    path = Path(robot_or_file) if is_file else configuration_file(robot_or_file)
    text = read(path)
    return loads(text, _schema(text, path.name), place=path.name, overrides=overrides)


def logged_configuration(config_text: str, overrides: Mapping[str, str] | None = None) -> RobotConfig:
    """The checked configuration that a log carries."""
    from runtime.configuration import loads

    place = "the log's configuration"
    return loads(config_text, _schema(config_text, place), place=place, overrides=overrides)


def assemble(robot: str, config_text: str, overrides: Mapping[str, str] | None = None) -> tuple[Loop, ...]:
    """The loops of a robot, from the resolved configuration in a log."""
    configuration_file(robot)
    return assembled(logged_configuration(config_text, overrides)).loops


def assembled(config: RobotConfig) -> Robot:
    """The robot that a configuration describes."""
    robot: Robot = _part(config.robot, "assembly").assemble(config)
    return robot


def description(config: RobotConfig) -> str:
    """The robot that a configuration describes, as URDF."""
    text: str = _part(config.robot, "description").description(config)
    return text


def rehearse(config: RobotConfig) -> bool:
    """Have the robot move in thought; true if it came to move."""
    moved: bool = _part(config.robot, "rehearsal").rehearse(config)
    return moved


def _schema(text: str, place: str) -> type[RobotConfig]:
    """The schema of the robot that a TOML text says it is of."""
    from runtime.configuration import top_level

    name = top_level(text, "robot", place)
    if not isinstance(name, str) or name not in ROBOTS:
        raise ConfigError(f"{place}: " + ("robot is missing" if name is None else unknown("robot", str(name), ROBOTS)))
    schema: type[RobotConfig] = _part(name, "config").CONFIG
    return schema


def _part(robot: str, name: str) -> Any:
    return import_module(f"runtime.robots.{_FOLDERS[robot]}.{name}")
