# SPDX-License-Identifier: Apache-2.0
"""A quadruped in simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from drivers.device_end import Wires
from drivers.dialects import dialect_named
from runtime.executors.loop_run import InputPort
from runtime.recording.stalls import StallBound
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.uslgo1.assembly import PATH_CAPACITY
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import BodyCommand, Gait
from runtime.tracking.path_csv import read_path_csv
from sim_bridge.courses import custom, scenario
from sim_bridge.quadruped_stall_bounds import quadruped_bounds
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.scenario import Push, Scenario
from sim_bridge.script import ScriptedOperator
from sim_bridge.terrain import HeightField
from sim_bridge.world import World

PUSH_DIRECTIONS, PUSH_PHASES = 8, 4


class QuadrupedSimulation:
    """See `sim_bridge.simulation.Simulation`."""

    warm_up, warm_up_ns = "flat", 1_300_000_000
    fallen_clearance_m = 0.1
    watched = (topics.GAIT,)

    def __init__(self, config: Uslgo1Config) -> None:
        self._config, self.step_ns = config, config.simulation.time_step_ns

    def scenario(self, name: str, seed: int) -> Scenario:
        """The scenario of a name; the seed of a push counts through directions, then gait phases."""
        changes = self._config.scenario
        chosen = custom(read_path_csv(name, capacity=PATH_CAPACITY)) if _is_file(name) else scenario(name)
        if changes.speed_mps > 0.0 and chosen.waypoints:
            chosen = chosen.with_speed(changes.speed_mps)
        if chosen.push is not None:
            direction = 2 * np.pi * (seed % PUSH_DIRECTIONS) / PUSH_DIRECTIONS
            phase = (seed // PUSH_DIRECTIONS) % PUSH_PHASES / PUSH_PHASES
            push = Push(direction_rad=direction, impulse_n_s=changes.push_impulse_n_s, gait_phase=phase)
            chosen = chosen.with_push(push)
        return chosen

    def world(self, course: Scenario, terrain: HeightField, wires: Wires, seed: int) -> QuadrupedWorld:
        """The robot at the start of a scenario: standing if it is to walk."""
        config = self._config
        height = config.posture.height_m if course.waypoints else config.posture.sitting_height_m
        return QuadrupedWorld(
            config.quadruped,
            config.simulation,
            config.drives.joints(config.safety),
            dialect_named(config.drives.dialect),
            terrain,
            wires,
            seed,
            course.start_pose,
            config.quadruped.standing_angles(height),
            height,
        )

    def sensors(self, world: World) -> Mapping[str, InputPort]:
        """IMU, localisation, battery."""
        assert isinstance(world, QuadrupedWorld)
        return {topics.IMU: world.imu, topics.LOCALIZATION: world.localization, topics.BATTERY: world.battery}

    def operator(self, course: Scenario, world: World) -> InputPort:
        """Has the robot stand up and walk, or sit down again where there is no path."""
        return ScriptedOperator(course, self._config.posture.rise_s)

    def finished(self, course: Scenario, records: Mapping[str, Record]) -> Callable[[], bool]:
        """Whether it is where the path ends, and walks no more."""
        gait, command = _gait(records), records[topics.BODY_COMMAND]
        assert isinstance(command, BodyCommand)
        return lambda: bool(command.arrived and not gait.walking)

    def ready(self, records: Mapping[str, Record]) -> Callable[[], bool]:
        """Whether its legs carry it under feedback."""
        return partial(getattr, _gait(records), "balancing")

    def broken(self, records: Mapping[str, Record]) -> Sequence[str]:
        """Its faults say all that it knows."""
        return ()

    def push_ns(self, push: Push, records: Mapping[str, Record], after_ns: int) -> int | None:
        """The first wanted phase of the gait after a time, once it walks."""
        gait, period_ns = _gait(records), self._config.gait.period_ns
        if not gait.walking:
            return None
        phase_ns = gait.cycle_start_ns + int(push.gait_phase * period_ns)
        return phase_ns + -(-(after_ns - phase_ns) // period_ns) * period_ns

    def stall_bounds(self) -> Sequence[StallBound]:
        """Those of its kind, by the configuration."""
        return quadruped_bounds(self._config)


SIMULATION = QuadrupedSimulation
"""Under the name by which every robot's is found."""


def _is_file(name: str) -> bool:
    return name.lower().endswith(".csv")


def _gait(records: Mapping[str, Record]) -> Gait:
    gait = records[topics.GAIT]
    assert isinstance(gait, Gait)
    return gait
