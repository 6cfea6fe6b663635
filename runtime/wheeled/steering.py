# SPDX-License-Identifier: Apache-2.0
"""From the motion of the vehicle to the steering angle and speed of each wheel (paper 002, eq 1-10, corrected).

The signed form: a wheel at (x, y) moves at (vx - w y, vy + w x), its angle is the direction of that and its speed the
size. One formula holds for both turning senses, any radius, crab and spinning in place. The same motion is had at an
angle half a turn away with the wheel running backwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from runtime.models.rotations import wrapped
from runtime.models.vehicle import VehicleGeometry

REACH_TOLERANCE_RAD = 1e-9


class Twist(NamedTuple):
    """Motion of the vehicle's centre: forward and left, m/s, and yaw rate, rad/s, positive to the left."""

    vx: float
    vy: float
    yaw_rate: float

    def scaled(self, share: float) -> Twist:
        """The same motion, slower: every wheel keeps its angle."""
        return Twist(share * self.vx, share * self.vy, share * self.yaw_rate)


STANDSTILL = Twist(0.0, 0.0, 0.0)


class WheelTargets(NamedTuple):
    """Steering angles, rad, and wheel speeds, rad/s, in the order of the wheels."""

    steering: tuple[float, ...]
    speed: tuple[float, ...]


def wheel_velocities(twist: Twist, geometry: VehicleGeometry) -> tuple[tuple[float, float], ...]:
    """Velocity of each wheel's centre over the ground, m/s."""
    vx, vy, yaw_rate = twist
    return tuple((vx - yaw_rate * y, vy + yaw_rate * x) for x, y in geometry.wheels)


def reachable_angle(direction: float, present: float, limit: float, slack: float = 0.0) -> float:
    """The steering angle nearest the present one at which a wheel can roll, either way, along a direction.

    Args:
        direction: of the wheel's motion, rad.
        present: steering angle, rad.
        limit: greatest angle to either side, rad.
        slack: how far beyond the limit a direction may lie and still be served by the limit itself, rad. It spares a
            wheel that moves to and fro about its limit the half turns.
    """
    ahead = wrapped(direction)
    choices = ahead, ahead - math.copysign(math.pi, ahead)
    within = [angle for angle in choices if abs(angle) - limit <= max(slack, REACH_TOLERANCE_RAD)]
    if not within:
        within = [min(choices, key=abs)]
    reached = [min(max(angle, -limit), limit) for angle in within]
    return min(reached, key=lambda angle: abs(angle - present))


def wheel_targets(
    twist: Twist, geometry: VehicleGeometry, present: Sequence[float], rest_mps: float = 1e-3, slack_rad: float = 0.0
) -> WheelTargets:
    """Angle and speed of each wheel.

    Args:
        twist: of the vehicle's centre.
        geometry: of the vehicle.
        present: steering angles to stay near, rad.
        rest_mps: a wheel slower than this keeps its angle and does not turn.
        slack_rad: see `reachable_angle`.
    """
    steering, speed = [], []
    for (vx, vy), angle in zip(wheel_velocities(twist, geometry), present, strict=True):
        rolling = math.hypot(vx, vy)
        if rolling < rest_mps:
            steering.append(angle)
            speed.append(0.0)
            continue
        direction = math.atan2(vy, vx)
        reached = reachable_angle(direction, angle, geometry.steering_range_rad, slack_rad)
        steering.append(reached)
        # the part along the wheel, negative where it runs backwards
        speed.append(rolling * math.cos(direction - reached) / geometry.wheel_radius_m)
    return WheelTargets(tuple(steering), tuple(speed))


def unsaturated(targets: WheelTargets, maximum_radps: float) -> WheelTargets:
    """The targets, all speeds scaled alike until none exceeds the maximum: the motion keeps its direction."""
    fastest = max(map(abs, targets.speed))
    if fastest <= maximum_radps:
        return targets
    return slowed(targets, maximum_radps / fastest)


def slowed(targets: WheelTargets, share: float) -> WheelTargets:
    """The targets with all speeds multiplied by a share."""
    return WheelTargets(targets.steering, tuple(share * speed for speed in targets.speed))


def steered_share(wanted: Sequence[float], measured: Sequence[float], full_rad: float, none_rad: float) -> float:
    """Share of the speed to go at while the wheels are not where they should be.

    Args:
        wanted: steering angles, rad.
        measured: steering angles, rad.
        full_rad: full speed up to this error of the worst wheel.
        none_rad: standstill from this error on; in between the share falls linearly.
    """
    worst = max(abs(w - m) for w, m in zip(wanted, measured, strict=True))
    return min(max((none_rad - worst) / (none_rad - full_rad), 0.0), 1.0)


def twist_of_wheels(steering: Sequence[float], speed: Sequence[float], geometry: VehicleGeometry) -> Twist:
    """The motion that fits wheels' angles (rad) and speeds (rad/s) best in the sense of least squares."""
    vx = vy = turning = square = 0.0
    for (x, y), angle, rate in zip(geometry.wheels, steering, speed, strict=True):
        rolling = rate * geometry.wheel_radius_m
        wx, wy = rolling * math.cos(angle), rolling * math.sin(angle)
        vx += wx
        vy += wy
        turning += x * wy - y * wx
        square += x * x + y * y
    count = len(geometry.wheels)
    return Twist(vx / count, vy / count, turning / square)
