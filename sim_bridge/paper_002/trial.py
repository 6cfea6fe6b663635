# SPDX-License-Identifier: Apache-2.0
"""One contender on one course and one plant, from a rolling start beside the path."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.models.dual_ackermann import inner_angle
from runtime.recording.metrics import Projection, project, time_average
from runtime.recording.settling import WINDOW_S, Settling, settling_of
from runtime.tracking.delay_estimation import DelayEstimator
from runtime.tracking.motion import Motion
from runtime.tracking.polyline import Polyline
from runtime.tracking.vehicle_answer import VehicleAnswer
from runtime.tracking.vehicle_tracker import TrackCommand, VehicleTracker
from sim_bridge.kinematic_vehicle import NS_PER_SECOND, KinematicPlant, KinematicVehicle
from sim_bridge.paper_002.contenders import Contender, DelayHandling, configuration, policy_of
from sim_bridge.paper_002.dead_reckoning import DeadReckoning
from sim_bridge.paper_002.plants import PLANTS
from sim_bridge.scenario import Scenario
from sim_bridge.vehicle_courses import scenario

Array = npt.NDArray[np.float64]
STRAIGHT = "straight"
PERIOD_NS = 120_000_000
"""Of the commands; the paper's figures are met at this period."""
LOOK_PERIOD_NS = 20_000_000
"""Of the looks at the wheels, as on the vehicle; it divides the period of the commands and all delays of the pose."""
BEGIN_S = 1.0
"""On the tracker's clock, whose times are positive."""
GOAL_PASSED_M = 1e-6
KEPT_EVERY = 10
"""Ticks from one sample that is kept to the next."""


class Trial(NamedTuple):
    """What is tried.

    Attributes:
        course: name of a scenario of the vehicle, which starts beside its path.
        plant: name of one of `PLANTS`.
        contender: who drives.
    """

    course: str
    plant: str
    contender: Contender


class Outcome(NamedTuple):
    """What came of it; errors are distances of the true centre to the path, until the goal is passed.

    Attributes:
        trial: which.
        arrived: at the goal, and stands; on the straight, where only a window is looked at, always true.
        mean_m: mean error, start included.
        settling: how the vehicle came to the path.
        inner_rad: largest steering angle of the inner front wheel that was asked for.
        delay_s: what the contender took the delay of the commands for in the end.
        t, xy, lateral_m: time, true position (n x 2) and signed error, of few samples; for pictures.
    """

    trial: Trial
    arrived: bool
    mean_m: float
    settling: Settling
    inner_rad: float
    delay_s: float
    t: Array
    xy: Array
    lateral_m: Array


class Driver:
    """A contender at the wheel of a kinematic vehicle that rolls already.

    Args:
        contender: who.
        course: what is followed.
        plant: what the contender is told of its steering, of the age of its pose, and of its delay if it is told.

    Attributes:
        delay_s: what the delay of the commands is taken for at present.
        geometry: of the vehicle.
    """

    def __init__(self, contender: Contender, course: Scenario, plant: KinematicPlant) -> None:
        config = configuration(contender, plant.steering_rate_radps, 0.0)
        following, self.geometry = config.tracker.following, config.vehicle
        self._answer: VehicleAnswer = following.answer
        self._speed = course.speed_mps
        self._tracker = VehicleTracker(policy_of(config), following, speed=config.speed_policy)
        self._tracker.take(course.waypoints, course.closed)
        self._tracker.restart(course.speed_mps)
        self._estimator: DelayEstimator | None = None
        self.delay_s = 0.0
        pose_age_s = 0.0 if contender.delay is DelayHandling.IGNORED else plant.pose_delay_ns / NS_PER_SECOND
        self._reckoning = DeadReckoning(pose_age_s, LOOK_PERIOD_NS / NS_PER_SECOND)
        if contender.delay is DelayHandling.KNOWN:
            self.delay_s = plant.command_delay_ns / NS_PER_SECOND
        elif contender.delay is DelayHandling.LEARNT:
            self._estimator = DelayEstimator(config.delay, self._answer)

    def look(self, seen: Motion) -> None:
        """Look at the wheels, once a `LOOK_PERIOD_NS`."""
        self._reckoning.look(seen)

    def command(self, now_s: float, seen: Motion) -> TrackCommand:
        """The command for what is seen, and has been looked at."""
        return self._tracker.step(now_s, self._reckoning.present(seen), self._speed, self.delay_s)

    def learn(self, now_s: float, seen: Motion, command: TrackCommand) -> None:
        """Learn the delay, or not, from what is seen and the command that holds."""
        if self._estimator is not None:
            self._estimator.step(now_s, seen.angle, seen.speed)
            self._estimator.add(now_s, command.speed, self._answer.angle_of(command.curvature))
            self.delay_s = self._estimator.delay_s


def drive(trial: Trial) -> Outcome:
    """Drive it."""
    course, plant = scenario(trial.course), PLANTS[trial.plant]
    driver = Driver(trial.contender, course, plant)
    limit_s = WINDOW_S if trial.course == STRAIGHT else course.time_limit_s
    driven = list(_driven(driver, course, plant, limit_s))
    x, y, yaw = np.array([motion[:3] for motion, _ in driven]).T
    t, xy = np.arange(len(x), dtype=np.float64) * (plant.tick_ns / NS_PER_SECOND), np.column_stack((x, y))
    path = Polyline(course.waypoints, course.closed)
    seen = _to_the_goal(project(x, y, yaw, path), path.length)
    count = len(seen.progress)
    t, xy = t[:count], xy[:count]
    return Outcome(
        trial,
        driven[-1][1].arrived or trial.course == STRAIGHT,
        time_average(t, seen.distance),
        settling_of(t, seen),
        max(inner_angle(command.requested, driver.geometry) for _, command in driven),
        driver.delay_s,
        t[::KEPT_EVERY],
        xy[::KEPT_EVERY],
        np.copysign(seen.distance, seen.lateral_error)[::KEPT_EVERY],
    )


def _to_the_goal(seen: Projection, length: float) -> Projection:
    """The part before the goal is passed, if it is: how far beyond it a vehicle stops is no error across the path."""
    passed = np.flatnonzero(seen.progress >= length - GOAL_PASSED_M)
    count = int(passed[0]) + 1 if len(passed) else len(seen.progress)
    return Projection(
        seen.progress[:count], seen.distance[:count], seen.lateral_error[:count], seen.heading_error[:count]
    )


def _driven(
    driver: Driver, course: Scenario, plant: KinematicPlant, limit_s: float
) -> Iterator[tuple[Motion, TrackCommand]]:
    """Motion and present command at each tick, until the vehicle stands at the goal or the time is over."""
    vehicle = KinematicVehicle(plant, course.start_pose, course.speed_mps)
    every, look_every = PERIOD_NS // plant.tick_ns, LOOK_PERIOD_NS // plant.tick_ns
    for tick in range(math.ceil(limit_s * NS_PER_SECOND / plant.tick_ns)):
        now_s, seen = BEGIN_S + tick * plant.tick_ns / NS_PER_SECOND, vehicle.seen
        if tick % look_every == 0:
            driver.look(seen)
        if tick % every == 0:
            command = driver.command(now_s, seen)
            vehicle.command(command.speed, command.curvature)
        if tick % look_every == 0:
            driver.learn(now_s, seen, command)
        yield vehicle.motion, command
        if command.arrived and vehicle.motion.speed == 0.0:
            return
        vehicle.advance()
