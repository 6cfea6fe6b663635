# SPDX-License-Identifier: Apache-2.0
"""Ideal vehicles that follow a tracker's commands: a unicycle, and a bicycle whose commands and poses come late."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from runtime.signals import BodyCommand, BodyState, OperatorRequest, Path, SafetyStatus
from runtime.tracking.motion import Motion
from runtime.tracking.paths import Polyline
from runtime.tracking.tracker import PathTracker
from runtime.tracking.tracker_config import TrackerConfig
from runtime.tracking.vehicle_tracker import VehicleTracker

PATH_AGE_MAX_NS = 60_000_000_000
SIZES = {"path": 512, "foot": 4, "foot_xyz": 12, "joint": 12}


@dataclass
class Drive:
    """A unicycle with optional imperfections, and the tracker that steers it.

    Attributes:
        waypoints: the path.
        lag_s: first-order lag of speed and yaw rate.
        drift_mps: steady lateral velocity.
        speed_gain: real over commanded speed.
        noise_m: standard deviation of the position, a new sample at 10 Hz.
    """

    waypoints: np.ndarray
    closed: bool = False
    speed: float = 0.6
    config: TrackerConfig = field(default_factory=TrackerConfig)
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lag_s: float = 0.0
    drift_mps: float = 0.0
    speed_gain: float = 1.0
    noise_m: float = 0.0
    seed: int = 0
    tick_s: float = 0.01
    window_s: float = 0.4

    def __post_init__(self) -> None:
        self.path, self.body = Path("path", SIZES), BodyState("body", SIZES)
        self.command = BodyCommand("command", SIZES)
        self.request, self.safety = OperatorRequest("request"), SafetyStatus("safety")
        self.tracker = PathTracker(
            self.path, self.body, self.request, self.safety, self.command, PATH_AGE_MAX_NS, self.config
        )
        self.x, self.y, self.yaw = self.start
        self.v = self.w = 0.0
        self.ticks = 0
        self.rng = np.random.Generator(np.random.PCG64(self.seed))
        self.error = np.zeros(2)
        self.velocities: deque[tuple[float, float]] = deque(maxlen=round(self.window_s / self.tick_s))
        self.line = Polyline(self.waypoints, self.closed)
        self.history: list[tuple[float, ...]] = []
        self.send()

    def send(self, stamp_ns: int = 1) -> None:
        count = len(self.waypoints)
        path = self.path
        path.stamp_ns, path.count, path.closed, path.speed = stamp_ns, count, self.closed, self.speed
        path.x[:count], path.y[:count] = np.asarray(self.waypoints).T

    def sense(self) -> None:
        if self.ticks % 10 == 0:
            self.error = self.rng.normal(0.0, 1.0, 2) * self.noise_m
        body = self.body
        body.stamp_ns = self.now_ns
        body.position = (self.x + self.error[0], self.y + self.error[1], 0.3)
        body.orientation = (0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2))
        body.angular_velocity = (0.0, 0.0, self.w)
        body.plane_normal = (0.0, 0.0, 1.0)
        body.course_velocity = np.mean(self.velocities, axis=0) if self.velocities else (0.0, 0.0)

    @property
    def now_ns(self) -> int:
        return 1_000_000_000 + round(self.ticks * self.tick_s * 1e9)

    def tick(self) -> None:
        if self.ticks % 4 == 0:
            self.sense()
            self.tracker.step(self.now_ns)
        share = 1.0 if self.lag_s == 0.0 else -math.expm1(-self.tick_s / self.lag_s)
        self.v += share * (self.speed_gain * self.command.velocity[0] - self.v)
        self.w += share * (self.command.yaw_rate - self.w)
        middle = self.yaw + 0.5 * self.w * self.tick_s
        side = self.drift_mps if self.v > 0.1 else 0.0
        vx = self.v * math.cos(middle) - side * math.sin(middle)
        vy = self.v * math.sin(middle) + side * math.cos(middle)
        self.x, self.y, self.yaw = self.x + vx * self.tick_s, self.y + vy * self.tick_s, self.yaw + self.w * self.tick_s
        self.velocities.append((vx, vy))
        self.ticks += 1
        self.history.append((self.ticks * self.tick_s, self.x, self.y, self.yaw, self.command.look_ahead))

    def run(self, limit_s: float = 120.0) -> Drive:
        """Until 2 s after arrival, or the limit."""
        while self.ticks * self.tick_s < limit_s:
            self.tick()
            if self.command.arrived and self.v < 0.005:
                break
        return self

    @property
    def distances(self) -> np.ndarray:
        """Distance to the path at every tick, m."""
        progress, out = 0.0, []
        for _, x, y, *_ in self.history:
            closest = self.line.closest(x, y, progress, 0.5)
            progress = closest.progress
            out.append(closest.distance)
        return np.array(out)


@pytest.fixture
def drive() -> type[Drive]:
    return Drive


@dataclass
class Bicycle:
    """A kinematic vehicle, steered at its centre angle, that drives a path at a steady speed.

    Attributes:
        waypoints: the path.
        controller: from a pose (x, y, yaw), centre angle and speed, as measured, to a speed and a curvature.
        start: true pose at first; it stands with its wheels straight, or rolls already.
        command_delay_s: from a command to the wheels.
        pose_delay_s: age of the pose that the controller is given.
        steering_rate: of the centre angle, rad/s.
        steering_lag_s: first-order lag of the centre angle, before the rate limit.
        period_s: of the controller.
    """

    waypoints: np.ndarray
    controller: Callable[[tuple[float, float, float], float, float], tuple[float, float]]
    closed: bool = False
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    command_delay_s: float = 0.0
    pose_delay_s: float = 0.0
    steering_rate: float = math.radians(20.0)
    steering_lag_s: float = 0.0
    acceleration: float = math.inf
    speed: float = 0.0
    period_s: float = 0.12
    tick_s: float = 0.01
    wheelbase: float = 1.17
    window_m: float = 3.0

    def __post_init__(self) -> None:
        self.pose, self.angle = self.start, 0.0
        self.line = Polyline(self.waypoints, self.closed)
        self.poses = deque([self.pose], maxlen=round(self.pose_delay_s / self.tick_s) + 1)
        self.pending = deque([(self.speed, 0.0)] * round(self.command_delay_s / self.tick_s))
        self.ticks, self.progress, self.asked = 0, 0.0, (self.speed, 0.0)
        self.lateral: list[float] = []
        self.track: list[tuple[float, float, float]] = []
        self.curvatures: list[float] = []

    def step(self) -> None:
        """One tick of the plant."""
        if self.ticks % round(self.period_s / self.tick_s) == 0:
            self.asked = self.controller(self.poses[0], self.angle, self.speed)
            self.curvatures.append(self.asked[1])
        self.pending.append(self.asked)
        speed, curvature = self.pending.popleft()
        change = self.acceleration * self.tick_s
        self.speed = speed if math.isinf(change) else self.speed + min(max(speed - self.speed, -change), change)
        wanted = math.atan(0.5 * self.wheelbase * curvature)
        if self.steering_lag_s > 0.0:
            wanted = self.angle + (wanted - self.angle) * self.tick_s / self.steering_lag_s
        turn = self.steering_rate * self.tick_s
        self.angle += min(max(wanted - self.angle, -turn), turn)
        x, y, yaw = self.pose
        yaw += self.tick_s * self.speed * 2.0 * math.tan(self.angle) / self.wheelbase
        x, y = x + self.tick_s * self.speed * math.cos(yaw), y + self.tick_s * self.speed * math.sin(yaw)
        self.pose = x, y, yaw
        self.poses.append(self.pose)
        self.ticks += 1
        closest = self.line.closest(x, y, self.progress, self.window_m)
        self.progress = closest.progress
        self.track.append(self.pose)
        self.lateral.append(math.copysign(closest.distance, closest.lateral_error))

    def run(self, duration_s: float) -> Bicycle:
        """Drive for a time."""
        for _ in range(round(duration_s / self.tick_s)):
            self.step()
        return self

    def mean_error(self, after_s: float = 0.0) -> float:
        """Mean distance to the path, m."""
        return float(np.mean(np.abs(self.lateral[round(after_s / self.tick_s) :])))

    def settling_time(self, within_m: float = 0.05) -> float:
        """When the error stays within a bound, s."""
        outside = np.flatnonzero(np.abs(self.lateral) > within_m)
        return float(outside[-1] + 1) * self.tick_s if len(outside) else 0.0

    def overshoot(self) -> float:
        """Largest error on the other side than at the start, m."""
        return max(0.0, float(np.max(-math.copysign(1.0, self.lateral[0]) * np.array(self.lateral))))


def following(policy: Any, waypoints: np.ndarray, speed: float, closed: bool = False) -> Any:
    """A controller out of a pursuit: it keeps to one speed and remembers how far along the path it is."""
    line, progress = Polyline(waypoints, closed), 0.0

    def controller(pose: tuple[float, float, float], angle: float, measured: float) -> tuple[float, float]:
        nonlocal progress
        closest = line.closest(pose[0], pose[1], progress, 3.0, beyond_goal=True)
        progress = closest.progress
        return speed, policy(line, Motion(*pose, measured, angle), closest).curvature

    return controller


class Tracked:
    """A controller out of a whole tracker: it knows the delay, and keeps all commands."""

    def __init__(self, policy, waypoints, speed, delay_s=0.0, closed=False, config=None, regulation=None, **more):
        self.tracker = VehicleTracker(policy, config, speed=regulation)
        self.tracker.take(waypoints, closed)
        self.speed, self.delay_s, self.period_s = speed, delay_s, more.get("period_s", 0.12)
        self.now_s, self.commands = 1.0, []
        self.halted = False
        if more.get("rolling"):
            self.tracker.restart(speed)

    def __call__(self, pose, angle, measured):
        motion = Motion(*pose, measured, angle, 2.0 * measured * math.tan(angle) / 1.17)
        command = self.tracker.step(self.now_s, motion, self.speed, self.delay_s, self.halted)
        self.now_s += self.period_s
        self.commands.append(command)
        return command.speed, command.curvature


class Answering:
    """What a vehicle that answers as modelled does in a short time of being asked for something else."""

    @staticmethod
    def angle(answer, angle, wanted, time_s):
        change = wanted - angle
        if answer.lag_s > 0.0:
            change *= -math.expm1(-time_s / answer.lag_s)
        most = answer.rate_radps * time_s
        return angle + min(max(change, -most), most)

    @staticmethod
    def speed(answer, speed, wanted, time_s):
        most = answer.acceleration_mps2 * time_s
        return speed + min(max(wanted - speed, -most), most)


@pytest.fixture(scope="session")
def answering():
    """How a vehicle answers."""
    return Answering


@pytest.fixture
def tracked():
    """What makes a controller of a whole tracker."""
    return Tracked


@pytest.fixture
def bicycle():
    """The kinematic vehicle."""
    return Bicycle


@pytest.fixture
def follower():
    """What makes a controller of a pursuit."""
    return following
