# SPDX-License-Identifier: Apache-2.0
"""What a simulated run must know of a robot: its world, its scenarios, and how one sees how it fares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Protocol

from drivers.device_end import Wires
from runtime.executors.loop_run import InputPort
from runtime.recording.stalls import StallBound
from runtime.records import Record
from runtime.robots.robot_config import RobotConfig
from sim_bridge.scenario import Push, Scenario
from sim_bridge.terrain import HeightField
from sim_bridge.world import World

_MODULES = {"uslgo1": "quadruped_simulation", "4ws4wd": "vehicle_simulation"}


class Simulation(Protocol):
    """A kind of robot in simulation.

    Attributes:
        warm_up, warm_up_ns: a scenario, and a time by which the robot moves and every part of its loops has been used.
        step_ns: of the physics.
        fallen_clearance_m: a robot whose origin is closer to the ground lies on it.
        watched: topics of what `finished`, `ready`, `broken` and `push_ns` look at.
    """

    warm_up: str
    warm_up_ns: int
    step_ns: int
    fallen_clearance_m: float
    watched: tuple[str, ...]

    def scenario(self, name: str, seed: int) -> Scenario:
        """The scenario of a name, or on the path of a CSV file, with the configuration's changes."""

    def world(self, course: Scenario, terrain: HeightField, wires: Wires, seed: int) -> World:
        """The robot at the start of a scenario."""

    def sensors(self, world: World) -> Mapping[str, InputPort]:
        """What the robot is told of itself and of the world by other ways than its buses, by topic."""

    def operator(self, course: Scenario, world: World) -> InputPort:
        """The operator of one run of a scenario, who sees the robot."""

    def finished(self, course: Scenario, records: Mapping[str, Record]) -> Callable[[], bool]:
        """Tells whether the robot has done all that is asked for in a scenario, from what its loops write."""

    def ready(self, records: Mapping[str, Record]) -> Callable[[], bool]:
        """Tells whether a robot that stands can go, from what its loops write."""

    def broken(self, records: Mapping[str, Record]) -> Sequence[str]:
        """What of a robot that has faulted is broken, in words, as far as it knows."""

    def push_ns(self, push: Push, records: Mapping[str, Record], after_ns: int) -> int | None:
        """When a push is to begin that is due after a time; None while that cannot be said."""

    def stall_bounds(self) -> Sequence[StallBound]:
        """Beyond which stalls of the machine the robot may have faults in real time."""


def simulation_of(config: RobotConfig) -> Simulation:
    """The simulation of the robot that a configuration describes."""
    made: Simulation = import_module(f"sim_bridge.{_MODULES[config.robot]}").SIMULATION(config)
    return made
