# SPDX-License-Identifier: Apache-2.0
"""What an assembled robot is."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.tasks import Loop


@dataclass(frozen=True)
class Robot:
    """The loops of a robot and the topics that tie them to the world.

    Attributes:
        name: of the robot.
        loops: in the order in which loops released at the same instant run.
        joint_names: in the order of every joint array.
    """

    name: str
    loops: tuple[Loop, ...]
    joint_names: tuple[str, ...]
