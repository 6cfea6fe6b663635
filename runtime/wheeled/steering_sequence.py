# SPDX-License-Identifier: Apache-2.0
"""Stop, steer, go: the order in which a vehicle changes from one way of steering to another.

Within a way of steering the wheels follow the motion while they roll. Where the next angles are far from the present
ones (another way of steering, a wheel that has to come round by half a turn) the vehicle first stops, then steers at a
standstill, and goes on when all wheels are where they should be.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from runtime.models.vehicle import VehicleGeometry
from runtime.vehicle_signals import SteeringMode
from runtime.wheeled.steering import (
    STANDSTILL,
    Twist,
    WheelTargets,
    slowed,
    steered_share,
    unsaturated,
    wheel_targets,
)

Angle = Annotated[float, Meta(gt=0.0, le=math.pi)]


class Phase(enum.IntEnum):
    """What the vehicle is at."""

    ROLLING = 0
    STOPPING = 1
    STEERING = 2


class SteeringLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When the vehicle waits for its wheels.

    Attributes:
        maximum_wheel_radps: greatest wheel speed.
        rest_mps: a motion is wanted once a wheel should roll faster than this.
        hold_mps: below this it is no longer wanted, and the wheels hold their angles.
        stopped_radps: a wheel slower than this stands.
        stopped_s: how long all wheels have to stand before they are steered.
        jump_rad: where the angle of a wheel should change by more than this at once, the vehicle stops for it.
        steered_rad: it goes on when all wheels are within this of their angles.
        full_speed_rad: while rolling, it slows down from this error of a wheel's angle on.
        no_speed_rad: and stands from this error on.
        slack_rad: how far a wheel may stay at its limit instead of coming round by half a turn.
    """

    maximum_wheel_radps: Annotated[float, Meta(gt=0.0, le=200.0)] = 16.0
    rest_mps: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.02
    hold_mps: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.01
    stopped_radps: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.15
    stopped_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.1
    jump_rad: Angle = 0.8
    steered_rad: Angle = 0.05
    full_speed_rad: Angle = 0.6
    no_speed_rad: Angle = 1.2
    slack_rad: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.1

    def __post_init__(self) -> None:
        """Check the bounds against each other.

        Raises:
            ValueError: if they cross.
        """
        if self.hold_mps > self.rest_mps:
            raise ValueError(f"hold_mps = {self.hold_mps} is above rest_mps = {self.rest_mps}")
        if self.full_speed_rad >= self.no_speed_rad:
            raise ValueError(f"full_speed_rad = {self.full_speed_rad} is not below no_speed_rad = {self.no_speed_rad}")
        if self.steered_rad >= self.jump_rad:
            raise ValueError(f"steered_rad = {self.steered_rad} is not below jump_rad = {self.jump_rad}")


class SteeringState(NamedTuple):
    """All that is remembered from step to step.

    Attributes:
        mode: a `SteeringMode`, the one the wheels are in.
        phase: a `Phase`.
        moving: whether a motion is wanted.
        stopped_s: how long the wheels have stood.
        angles: of the last targets, rad.
    """

    mode: int
    phase: int
    moving: bool
    stopped_s: float
    angles: tuple[float, ...]


def standing(steering: Sequence[float], mode: SteeringMode = SteeringMode.ACKERMANN) -> SteeringState:
    """The state of a vehicle that stands with its wheels at these angles."""
    return SteeringState(int(mode), int(Phase.STEERING), False, 0.0, tuple(steering))


def within_mode(twist: Twist, mode: int) -> Twist:
    """The part of a motion that a way of steering can do."""
    if mode == SteeringMode.ACKERMANN:
        return Twist(twist.vx, 0.0, twist.yaw_rate if twist.vx else 0.0)
    if mode == SteeringMode.CRAB:
        return Twist(twist.vx, twist.vy, 0.0)
    if mode == SteeringMode.SPIN:
        return Twist(0.0, 0.0, twist.yaw_rate)
    return twist


def next_targets(
    state: SteeringState,
    twist: Twist,
    mode: int,
    steering: Sequence[float],
    speed: Sequence[float],
    dt: float,
    geometry: VehicleGeometry,
    limits: SteeringLimits,
) -> tuple[SteeringState, WheelTargets]:
    """One step.

    Args:
        state: of the step before.
        twist: wanted.
        mode: the wanted `SteeringMode`.
        steering: measured angles, rad.
        speed: measured wheel speeds, rad/s.
        dt: since the step before, s.
        geometry: of the vehicle.
        limits: the limits.

    Returns:
        The new state and what to ask of the wheels.
    """
    motion = within_mode(twist, mode)
    moving = fastest_wheel(motion, geometry) > (limits.hold_mps if state.moving else limits.rest_mps)
    if not moving:
        motion = STANDSTILL
    # a wheel on the centre of rotation holds its angle, at any speed of the others
    wanted = wheel_targets(motion, geometry, state.angles, limits.hold_mps, limits.slack_rad)
    stopped_s = state.stopped_s + dt if max(map(abs, speed)) <= limits.stopped_radps else 0.0
    phase = _next_phase(state, wanted, mode, moving, stopped_s, steering, limits)
    held = WheelTargets(state.angles, (0.0,) * len(state.angles))
    if phase == Phase.STOPPING or not moving:
        return SteeringState(state.mode, phase, moving, stopped_s, state.angles), held
    share = 0.0
    if phase == Phase.ROLLING:
        share = steered_share(wanted.steering, steering, limits.full_speed_rad, limits.no_speed_rad)
    targets = slowed(unsaturated(wanted, limits.maximum_wheel_radps), share)
    return SteeringState(mode, phase, True, stopped_s, wanted.steering), targets


def fastest_wheel(twist: Twist, geometry: VehicleGeometry) -> float:
    """Speed of the fastest wheel over the ground, m/s."""
    x, y = 0.5 * geometry.wheelbase_m, 0.5 * geometry.track_m
    return math.hypot(abs(twist.vx) + abs(twist.yaw_rate) * y, abs(twist.vy) + abs(twist.yaw_rate) * x)


def _next_phase(
    state: SteeringState,
    wanted: WheelTargets,
    mode: int,
    moving: bool,
    stopped_s: float,
    steering: Sequence[float],
    limits: SteeringLimits,
) -> int:
    rested = stopped_s >= limits.stopped_s
    leap = mode != state.mode or _largest_change(wanted.steering, state.angles) > limits.jump_rad
    if state.phase == Phase.ROLLING and moving and leap:
        return int(Phase.STEERING) if rested else int(Phase.STOPPING)
    if state.phase == Phase.STOPPING:
        if moving and not leap:
            return int(Phase.ROLLING)
        return int(Phase.STEERING) if rested else int(Phase.STOPPING)
    if state.phase == Phase.STEERING and moving:
        arrived = _largest_change(wanted.steering, steering) <= limits.steered_rad
        return int(Phase.ROLLING) if arrived else int(Phase.STEERING)
    return state.phase


def _largest_change(wanted: Sequence[float], present: Sequence[float]) -> float:
    return max(abs(w - p) for w, p in zip(wanted, present, strict=True))
