# SPDX-License-Identifier: Apache-2.0
"""Following a path with a vehicle: progress, sections, speed, and a policy of steering, from a pose to a command."""

from __future__ import annotations

from typing import Annotated, NamedTuple, Protocol

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from runtime.models.rotations import wrapped
from runtime.tracking.motion import Motion
from runtime.tracking.path_speed import PathSpeed, SpeedPolicy
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.prediction import CommandHistory
from runtime.tracking.sections import SectionedPath, begins_backwards
from runtime.tracking.speed import SpeedLimits, ramped
from runtime.tracking.turn import TurnLimits, needs_turn, turn_rate
from runtime.tracking.vehicle_answer import VehicleAnswer
from runtime.tracking.waypoint_pursuit import Pursuit

Array = npt.NDArray[np.float64]
Window = Annotated[float, Meta(ge=0.1, le=20.0)]


class SteeringPolicy(Protocol):
    """Which arc to drive."""

    def __call__(self, path: Polyline, motion: Motion, closest: ClosestPoint) -> Pursuit:
        """The arc for a vehicle that drives forwards; the closest point of the path is known."""


class VehicleTrackerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the tracker besides those of the policy.

    Attributes:
        answer: of the vehicle to its commands.
        speed: limits of the speed and its changes.
        turn: when and how to turn in place.
        search_window_m: how far ahead of the last progress the closest point is searched.
        start_window_m: the same where a path or a section begins; the vehicle may stand that far along it.
        standstill_mps: speed below which the vehicle stands.
        longest_step_s: a longer gap between steps counts as this.
    """

    answer: VehicleAnswer = VehicleAnswer()
    speed: SpeedLimits = SpeedLimits(
        maximum_mps=3.0,
        acceleration_mps2=0.8,
        deceleration_mps2=0.8,
        lateral_acceleration_mps2=2.0,
        maximum_yaw_rate_radps=1.5,
    )
    turn: TurnLimits = TurnLimits(start_rad=1.9, stop_rad=0.3, maximum_radps=0.6, deceleration_radps2=0.5)
    search_window_m: Window = 1.5
    start_window_m: Window = 3.0
    standstill_mps: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.03
    longest_step_s: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.2


class TrackState(NamedTuple):
    """What the tracker remembers besides the commands that are on their way; numbers all.

    Attributes:
        time_s: of the last step, 0 before the first.
        section: that is driven.
        backwards: 1 where it is driven so.
        progress: along the section, m; below 0 before its first step.
        forward: last command, m/s, negative backwards.
        curvature: last command, 1/m.
        turning: 1 while turning in place.
        arrived: 1 at the goal.
    """

    time_s: float = 0.0
    section: float = 0.0
    backwards: float = 0.0
    progress: float = -1.0
    forward: float = 0.0
    curvature: float = 0.0
    turning: float = 0.0
    arrived: float = 0.0


class TrackCommand(NamedTuple):
    """What is asked of the vehicle.

    Attributes:
        speed: forward, m/s, negative backwards.
        curvature: of the centre's path, 1/m: yaw rate per forward speed.
        yaw_rate: rad/s; that of turning in place where `turning`.
        turning: in place.
        requested: curvature that the policy asked for, before the steering's rate, 1/m.
        target: point that is pursued, m.
        look_ahead: m, 0 where the policy has none.
        pose: (x, y, yaw) that the command is made for: where the vehicle will be when it takes effect.
        lateral_error: of that pose, m, positive with the path to the right.
        heading_error: of that pose, rad, against the direction of driving.
        progress: arc length along the whole path, m.
        remaining: arc length to the goal, m.
        arrived: the vehicle is at the goal.
    """

    speed: float
    curvature: float
    yaw_rate: float
    turning: bool
    requested: float
    target: tuple[float, float]
    look_ahead: float
    pose: tuple[float, float, float]
    lateral_error: float
    heading_error: float
    progress: float
    remaining: float
    arrived: bool


class VehicleTracker:
    """Steers a vehicle along a path, once, from its start to its goal.

    A path that turns back at cusps is driven in sections, forwards and backwards in turn; a vehicle that points away
    from a path at its start drives it backwards. At a cusp the vehicle stops before it goes on.

    Args:
        policy: which arc to drive.
        config: everything else.
        memory: all that is remembered from step to step, `VehicleTracker.SIZE` numbers; `forget` before the first.
        speed: how fast to drive it; by default as fast as bends, the steering and the goal allow.

    Attributes:
        memory: as above.
    """

    SIZE = len(TrackState._fields) + CommandHistory.SIZE

    def __init__(
        self,
        policy: SteeringPolicy,
        config: VehicleTrackerConfig | None = None,
        memory: Array | None = None,
        speed: SpeedPolicy | None = None,
    ) -> None:
        self._policy, self._config = policy, config or VehicleTrackerConfig()
        self._speed = speed or PathSpeed(self._config.speed, self._config.answer)
        self.memory = np.zeros(self.SIZE) if memory is None else memory
        count = len(TrackState._fields)
        self._scalars = self.memory[:count]
        self._history = CommandHistory(self.memory[count:])
        self._course: SectionedPath | None = None
        if memory is None:
            self.forget()

    def forget(self) -> None:
        """Forget all but the path."""
        self.memory[:] = 0.0
        self._scalars[:] = TrackState()

    def take(self, points: npt.ArrayLike, closed: bool = False) -> SectionedPath:
        """Take up a path, and return it, without touching what is remembered, as after that has been restored.

        Raises:
            PathError: if it cannot be followed; the one before is kept.
        """
        self._course = SectionedPath(points, closed)
        return self._course

    def begin(self) -> None:
        """Begin the path anew; what was commanded is still remembered."""
        old = self._state
        self._scalars[:] = TrackState(time_s=old.time_s, forward=old.forward, curvature=old.curvature)

    def restart(self, speed: float) -> None:
        """Begin the path with a vehicle that rolls straight ahead at this speed, m/s, unasked."""
        self.forget()
        self._scalars[:] = TrackState(forward=speed)

    def note(self, now_s: float, forward: float, curvature: float | None) -> None:
        """Learn of a command that was not for the path, so that the way back to the path begins with it.

        Args:
            now_s: time, positive.
            forward: m/s, negative backwards.
            curvature: 1/m; None where the wheels hold their angles.
        """
        state = self._state
        held = state.curvature if curvature is None else curvature
        self._scalars[:] = state._replace(time_s=now_s, forward=forward, curvature=held, turning=0.0)
        self._history.add(now_s, forward, self._config.answer.angle_of(held))

    @property
    def _state(self) -> TrackState:
        return TrackState(*self._scalars.tolist())

    def step(
        self,
        now_s: float,
        motion: Motion,
        wanted_mps: float,
        delay_s: float = 0.0,
        halted: bool = False,
        grip: float = 1.0,
    ) -> TrackCommand:
        """The command for now. A path must have been taken up.

        Args:
            now_s: time, positive.
            motion: of the vehicle, now.
            wanted_mps: speed along the path.
            delay_s: from a command to the wheels; 0 compensates for none.
            halted: slow to a stand, and keep to the path meanwhile.
            grip: share of the accelerations that may be counted on, 0 to 1.
        """
        state, config, course = self._state, self._config, self._course
        assert course is not None
        dt = min(max(now_s - state.time_s, 0.0), config.longest_step_s) if state.time_s > 0.0 else 0.0
        ahead = self._at_effect(now_s, motion, bool(state.turning), delay_s)
        if state.progress < 0.0 and state.section == 0.0:
            state = state._replace(backwards=float(begins_backwards(course.sections[0], ahead.yaw)))
        state, path = self._present_section(state._replace(time_s=now_s), motion, course)
        sign = -1.0 if state.backwards else 1.0
        seen = ahead.reversed() if state.backwards else ahead
        window = config.start_window_m if state.progress < 0.0 else config.search_window_m
        closest = path.closest(seen.x, seen.y, max(state.progress, 0.0), window, beyond_goal=True)
        remaining = path.length - closest.progress
        last = state.section == len(course.sections) - 1
        state = state._replace(progress=closest.progress)
        if last and remaining <= config.speed.goal_tolerance_m:
            state = state._replace(arrived=1.0)
        heading_error = wrapped(seen.yaw - closest.heading)
        turning = not state.arrived and needs_turn(bool(state.turning), heading_error, config.turn)
        pursuit = self._policy(path, seen, closest)
        stand = halted or turning or bool(state.arrived)
        wanted = 0.0 if stand else self._speed(path, pursuit.curvature, closest.progress, remaining, wanted_mps, grip)
        limits = config.speed
        speed = ramped(sign * state.forward, wanted, grip * limits.acceleration_mps2, limits.deceleration_mps2, dt)
        if state.arrived:
            speed = 0.0
        curvature = sign * state.curvature
        if not turning:
            curvature = config.answer.slewed(curvature, pursuit.curvature, dt or config.longest_step_s)
        spin = turning and speed == 0.0 and not halted
        state = state._replace(forward=sign * speed, curvature=sign * curvature, turning=float(turning))
        self._scalars[:] = state
        self._history.add(now_s, state.forward, config.answer.angle_of(state.curvature))
        before = course.begins[int(state.section)]
        after = course.length - (before + path.length)
        return TrackCommand(
            state.forward,
            state.curvature,
            turn_rate(-heading_error, config.turn) if spin else speed * curvature,
            spin,
            sign * pursuit.curvature,
            pursuit.target,
            pursuit.look_ahead,
            (ahead.x, ahead.y, ahead.yaw),
            closest.lateral_error,
            heading_error,
            before + min(closest.progress, path.length),
            max(remaining, 0.0) + after,
            bool(state.arrived),
        )

    def _at_effect(self, now_s: float, motion: Motion, turning: bool, delay_s: float) -> Motion:
        """The motion when a command of now takes effect."""
        if delay_s <= 0.0:
            return motion
        if turning:
            return motion._replace(yaw=motion.yaw + delay_s * motion.yaw_rate)
        return self._history.predicted(motion, now_s, delay_s, self._config.answer)

    def _present_section(self, state: TrackState, motion: Motion, course: SectionedPath) -> tuple[TrackState, Polyline]:
        """The section to drive: the next one, once the vehicle stands at the end of one."""
        section = int(state.section)
        path = course.sections[section]
        over = state.progress >= path.length - self._config.speed.goal_tolerance_m
        if over and section + 1 < len(course.sections) and abs(motion.speed) < self._config.standstill_mps:
            state = state._replace(
                section=float(section + 1),
                backwards=1.0 - state.backwards,
                progress=-1.0,
                forward=0.0,
            )
        return state, course.sections[int(state.section)]
