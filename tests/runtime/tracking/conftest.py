# SPDX-License-Identifier: Apache-2.0
"""An ideal unicycle that follows the tracker's commands."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import pytest

from runtime.signals import BodyCommand, BodyState, OperatorRequest, Path, SafetyStatus
from runtime.tracking.paths import Polyline
from runtime.tracking.tracker import PathTracker
from runtime.tracking.tracker_config import TrackerConfig

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
        self.tracker = PathTracker(self.path, self.body, self.request, self.safety, self.command, self.config)
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
