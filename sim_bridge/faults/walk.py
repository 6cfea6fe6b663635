# SPDX-License-Identifier: Apache-2.0
"""A fault in a walk: what the quadruped does about it, and whether its joints stay within their limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from runtime.records import Record
from runtime.robots import load_configuration, topics
from runtime.robots.robot import Robot
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Gait, JointCommand, Mode
from sim_bridge.faults.joint_limits import JointLimits
from sim_bridge.faults.row import Row
from sim_bridge.faults.trial import Expectation
from sim_bridge.faults.watch import Watch
from sim_bridge.quadruped_world import QuadrupedWorld

WALKING_NS = 1_600_000_000
"""By then the robot trots at nearly its full speed."""


class WalkWatch(Watch):
    """Names as answers: walk on, derate, stand, go on, crouch, damp.

    Args:
        row: the fault.
        config: of the robot.
        robot: whose signals are looked at;
        world: and its true state.
        begin_ns: when the fault begins.
        others: further records that the row may count.
    """

    unimpressed, final = "walk on", "damp"

    def __init__(
        self,
        row: Expectation[Uslgo1Config],
        config: Uslgo1Config,
        robot: Robot,
        world: QuadrupedWorld,
        begin_ns: int,
        others: Mapping[str, Record] = MappingProxyType({}),
    ) -> None:
        super().__init__(row, robot, begin_ns, others)
        self._safety, self._world, self._limits = config.safety, world, JointLimits(config.safety)
        gait, command = self._records[topics.GAIT], self._records[topics.JOINT_COMMAND_SAFE]
        assert isinstance(gait, Gait)
        assert isinstance(command, JointCommand)
        self._gait, self._command = gait, command

    def _signs(self) -> Mapping[str, bool]:
        status, walking = self.status, bool(self._gait.walking)
        powered = status.mode in (Mode.STANDING, Mode.ACTIVE)
        return {
            "derate": status.derated,
            "stand": powered and not walking,
            "go on": powered and walking and "stand" in self.seen,
            "crouch": status.mode == Mode.CROUCHING,
            "damp": status.mode == Mode.DAMPED,
        }

    def _check(self) -> None:
        world, command, safety = self._world, self._command, self._safety
        if "damp" in self.seen:
            idle = not command.stiffness.any() and not command.effort.any() and not command.velocity.any()
            self._stop_kept = self._stop_kept and idle
            return
        bound = safety.derated_effort_nm if self.status.derated else safety.effort_max_nm
        kept = self._limits.kept(world) and bool((np.abs(command.effort) <= bound).all())
        self._limits_kept = self._limits_kept and kept
        self._fell = self._fell or world.tilt > safety.tilt_max_rad + 0.1


@dataclass(frozen=True)
class WalkRow(Row[Uslgo1Config, QuadrupedWorld]):
    """A fault at some phase of the gait."""

    robot, course = "uslgo1", "flat"

    @property
    def config(self) -> Uslgo1Config:
        """See `Row`."""
        config = load_configuration(self.robot, self.settings)
        assert isinstance(config, Uslgo1Config)
        return config

    def strikes_ns(self, config: Uslgo1Config) -> tuple[int, int]:
        """See `Row`."""
        return WALKING_NS, WALKING_NS + config.gait.period_ns

    def watch(self, config: Uslgo1Config, robot: Robot, world: QuadrupedWorld, begin_ns: int) -> Watch:
        """See `Row`."""
        return WalkWatch(self, config, robot, world, begin_ns)
