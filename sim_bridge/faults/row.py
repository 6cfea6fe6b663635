# SPDX-License-Identifier: Apache-2.0
"""A fault of a table, and the robot that it befalls."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Generic

from runtime.robots.robot import Robot
from runtime.signals import Fault
from sim_bridge.faults.watch import Watch
from sim_bridge.faults.wires import FOREVER_NS, ConfigT, Inject, Wires, WorldT


@dataclass(frozen=True)
class Row(ABC, Generic[ConfigT, WorldT]):
    """A fault and its answer; a kind of robot adds how it is under way when the fault begins.

    Attributes:
        robot: which it befalls;
        course: on this scenario.
        name: for people.
        inject: prepares it.
        answer: what the robot is to do, in order, as its watch names it.
        bound_ns: how soon the last of it (but going on) is to be reached, of the configuration.
        lasts_ns: how long the fault is there.
        fault: bits by which it is to be named.
        counted: topic and field of what is to be counted.
        mended: called with the wires and the time at which the fault ends.
        forced: whether a force from outside may take the robot beyond its limits.
        settings: configuration that shows this answer.
    """

    robot: ClassVar[str]
    course: ClassVar[str]

    name: str
    inject: Inject
    answer: tuple[str, ...]
    bound_ns: Callable[[ConfigT], int]
    lasts_ns: int = FOREVER_NS
    fault: Fault = Fault.NONE
    counted: tuple[str, str] | None = None
    mended: Callable[[Wires[ConfigT, WorldT], int], None] | None = None
    forced: bool = False
    settings: dict[str, str] = field(default_factory=dict)

    @property
    @abstractmethod
    def config(self) -> ConfigT:
        """The configuration that it is tried with."""

    @abstractmethod
    def strikes_ns(self, config: ConfigT) -> tuple[int, int]:
        """From when on, and until before when, it may begin: the robot is under way then."""

    @abstractmethod
    def watch(self, config: ConfigT, robot: Robot, world: WorldT, begin_ns: int) -> Watch:
        """Somebody who looks at the robot."""
