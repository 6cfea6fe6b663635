# SPDX-License-Identifier: Apache-2.0
"""A fault in a drive: what the vehicle does about it, and whether its commands stay within their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from runtime.robots import load_configuration, topics
from runtime.robots.robot import Robot
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.safety.vehicle_task import STILL_RADPS
from runtime.signals import Mode
from runtime.vehicle_signals import WheelCommand
from sim_bridge.faults.row import Row
from sim_bridge.faults.trial import Expectation
from sim_bridge.faults.watch import Watch
from sim_bridge.faults.wheel_limits import WheelLimits
from sim_bridge.vehicle_world import VehicleWorld

SPEED_MPS = 1.0
DRIVING_NS, PHASES_NS = 2_000_000_000, 2_500_000_000
"""From when on the vehicle goes at its full speed, and how long it then takes from the straight into a bend."""
FALLEN_RAD = 0.5 * math.pi
"""Tilt of a vehicle that lies on its side."""


class DriveWatch(Watch):
    """Names as answers: drive on, stand, go on, brake, rest.

    A vehicle that brakes slows down for good. It rests when its wheels stand still, as they truly are; by then, or soon
    after if the vehicle cannot know it, its brakes are to be on.

    Args:
        row: the fault.
        config: of the vehicle.
        robot: whose signals are looked at;
        world: and its true state.
        begin_ns: when the fault begins.
    """

    unimpressed, final = "drive on", "rest"

    def __init__(
        self,
        row: Expectation[Vehicle4ws4wdConfig],
        config: Vehicle4ws4wdConfig,
        robot: Robot,
        world: VehicleWorld,
        begin_ns: int,
    ) -> None:
        super().__init__(row, robot, begin_ns)
        self._world = world
        self._brakes_late_ns = config.safety.stop_max_ns + config.loops.drive_period_ns
        command = self._records[topics.WHEEL_COMMAND_SAFE]
        assert isinstance(command, WheelCommand)
        self._command, self._limits = command, WheelLimits(config)
        self._slowest: float | None = None

    def look(self, now_ns: int) -> None:
        """See `Watch`; changes are judged by the command before, so that those before the fault are looked at too."""
        self._limits_kept = self._limits.kept(self._command, self._world.unit.motors.target) and self._limits_kept
        super().look(now_ns)

    def over(self, now_ns: int) -> bool:
        """See `Watch`; that a vehicle puts its brakes on is waited for."""
        return super().over(now_ns) and not ("brake" in self.seen and self._command.enable)

    def _signs(self) -> Mapping[str, bool]:
        mode, command = self.status.mode, self._command
        powered = mode in (Mode.STANDING, Mode.ACTIVE)
        stands = not command.speed.any() and bool((np.abs(self._world.wheel_speeds) <= STILL_RADPS).all())
        return {
            "stand": powered and stands,
            "go on": powered and bool(command.speed.any()) and "stand" in self.seen,
            "brake": mode == Mode.DAMPED,
            "rest": mode == Mode.DAMPED and stands,
        }

    def _check(self) -> None:
        command = self._command
        if "brake" in self.seen:
            asked = float(np.abs(command.speed).max())
            slows = self._slowest is None or asked <= self._slowest
            brakes = not command.enable or self.status.stamp_ns - self.seen["brake"] <= self._brakes_late_ns
            self._slowest, self._stop_kept = asked, self._stop_kept and slows and brakes
        else:
            self._fell = self._fell or self._world.tilt > FALLEN_RAD


@dataclass(frozen=True)
class DriveRow(Row[Vehicle4ws4wdConfig, VehicleWorld]):
    """A fault on a straight, where a bend begins, or in it."""

    robot, course = "4ws4wd", "slalom"

    @property
    def config(self) -> Vehicle4ws4wdConfig:
        """See `Row`."""
        config = load_configuration(self.robot, {"scenario.speed_mps": str(SPEED_MPS), **self.settings})
        assert isinstance(config, Vehicle4ws4wdConfig)
        return config

    def strikes_ns(self, config: Vehicle4ws4wdConfig) -> tuple[int, int]:
        """See `Row`."""
        return DRIVING_NS, DRIVING_NS + PHASES_NS

    def watch(self, config: Vehicle4ws4wdConfig, robot: Robot, world: VehicleWorld, begin_ns: int) -> Watch:
        """See `Row`."""
        return DriveWatch(self, config, robot, world, begin_ns)
