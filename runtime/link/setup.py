# SPDX-License-Identifier: Apache-2.0
"""What the link is told of the robot it serves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from runtime.robots import assembled, description
from runtime.robots.link_config import LinkConfig
from runtime.tasks import Loop

if TYPE_CHECKING:
    from runtime.robots.robot_config import RobotConfig


@dataclass(frozen=True)
class LinkSetup:
    """What the link is told of the robot.

    Attributes:
        robot: its name.
        loops: of the control process.
        joint_names: in the order of the robot's joints.
        description: of the robot, as URDF.
        config: of the link.
        priority: of its threads.
        processors: that they may run on; none for all.
        switch_interval_us: how long a thread that wants the interpreter waits for one that computes.
    """

    robot: str
    loops: tuple[Loop, ...]
    joint_names: tuple[str, ...]
    description: str
    config: LinkConfig
    priority: int
    processors: tuple[int, ...]
    switch_interval_us: int


def link_setup(config: RobotConfig) -> LinkSetup:
    """What the link is told, from a robot's configuration."""
    robot, realtime = assembled(config), config.realtime
    return LinkSetup(
        robot.name,
        robot.loops,
        robot.joint_names,
        description(config),
        config.link,
        realtime.link_priority,
        realtime.link_processors,
        realtime.link_switch_interval_us,
    )
