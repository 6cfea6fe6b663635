# SPDX-License-Identifier: Apache-2.0
"""What a scenario is: a path, the ground below it, a speed, and when it counts as done."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

from runtime.errors import UgvError
from sim_bridge.ground_friction import FrictionPatch
from sim_bridge.terrain import HeightField

TIME_FACTOR = 1.5
"""A run may take this many times the nominal time."""

Points = tuple[tuple[float, float], ...]


class UnknownScenarioError(UgvError, ValueError):
    """No scenario has this name."""


@dataclass(frozen=True)
class Push:
    """A rectangular force at the trunk's centre of mass while trotting.

    Attributes:
        direction_rad: from the trunk's yaw at the push, fixed while it lasts; 0 pushes forward, positive to the left.
        impulse_n_s: N.s.
        gait_phase: phase of the gait cycle at which it begins, 0 to 1.
        after_s: it begins at the first such phase this long after first motion.
        duration_s: s.
        recovery_s: the robot is back within `recovered_m` of the path this long after it.
        recovered_m: m.
    """

    direction_rad: float = math.pi / 2
    impulse_n_s: float = 10.0
    gait_phase: float = 0.0
    after_s: float = 5.0
    duration_s: float = 0.1
    recovery_s: float = 5.0
    recovered_m: float = 0.15

    @property
    def force_n(self) -> float:
        """Size of the force, N."""
        return self.impulse_n_s / self.duration_s


@dataclass(frozen=True)
class Scenario:
    """What to run.

    Attributes:
        name: as asked for.
        waypoints: the path in plan coordinates, m; empty where the robot only stands.
        closed: the path leads back to its first waypoint.
        speed_mps: commanded, along the surface.
        start_pose: x (m), y (m), yaw (rad).
        terrain: the ground for a seed.
        profile: plan arc length and height (m) of the corners of the ground along the path, undulation left out.
        nominal_time_s: surface length over speed, and the time beside.
        time_beside_s: of it, for what takes as long at every speed: starting, stopping, turning.
        stand_s: how long to stand before sitting down, where there is no path.
        push: the push, if any.
        velocity: forward, lateral (m/s) and yaw rate (rad/s) that the operator asks for, until the robot is where the
            path ends; None where the robot follows the path by itself.
        turn_rad: how far to turn at that velocity, where there is no path.
        patches: of ground with a friction of its own.
    """

    name: str
    waypoints: Points
    closed: bool
    speed_mps: float
    start_pose: tuple[float, float, float]
    terrain: Callable[[int], HeightField]
    profile: Points
    nominal_time_s: float
    time_beside_s: float = 0.0
    stand_s: float = 0.0
    push: Push | None = None
    velocity: tuple[float, float, float] | None = None
    turn_rad: float = 0.0
    patches: tuple[FrictionPatch, ...] = ()

    @property
    def time_limit_s(self) -> float:
        """A run that takes longer from first motion has failed."""
        return TIME_FACTOR * self.nominal_time_s

    def with_push(self, push: Push) -> Scenario:
        """The same scenario with another push."""
        return dataclasses.replace(self, push=push)

    def with_speed(self, speed_mps: float) -> Scenario:
        """The same scenario at another speed.

        Raises:
            ValueError: if the speed is not positive and finite, or the scenario has no path.
        """
        if not (math.isfinite(speed_mps) and speed_mps > 0.0):
            raise ValueError(f"{self.name}: speed = {speed_mps} m/s must be positive and finite")
        if not self.waypoints:
            raise ValueError(f"{self.name}: has no path, so no speed can be set")
        travelling_s = (self.nominal_time_s - self.time_beside_s) * self.speed_mps / speed_mps
        return dataclasses.replace(self, speed_mps=speed_mps, nominal_time_s=travelling_s + self.time_beside_s)
