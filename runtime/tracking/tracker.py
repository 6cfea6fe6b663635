# SPDX-License-Identifier: Apache-2.0
"""The tracking task: from a path and the estimate of the body to a command for the body."""

from __future__ import annotations

import math

from runtime.models.rotations import wrapped
from runtime.signals import BodyCommand, BodyState, Mode, Motion, OperatorRequest, Path, SafetyStatus, Steering
from runtime.tasks import Task
from runtime.tracking.followed_path import FollowedPath
from runtime.tracking.inputs import planar_pose
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.pure_pursuit import bearing, drift_angle, low_pass, pursuit_curvature
from runtime.tracking.speed import (
    approach_speed,
    next_trim,
    ramped,
    regulated_speed,
    surface_stretch,
)
from runtime.tracking.tracker_config import TrackerConfig, TrackerState
from runtime.tracking.turn import needs_turn, turn_rate
from runtime.tracking.velocity import REST, PlanarVelocity, approached, wanted_velocity


class PathTracker(Task):
    """Fuzzy pure pursuit with speed regulation (paper 000, section 3), stepped at 25 Hz.

    A path whose contents cannot be followed, or that is not of the lease's holder, is counted and the one before is
    kept; a path without waypoints withdraws it. A path is run from its start, to its goal, once: the same waypoints
    sent again only change the speed, and are run again only after a withdrawal. While the body state is not finite the
    command is zero.

    It slows to a stand, and goes on from there, when safety asks for it, when a walking robot is asked to stand, or
    when there is no path any more. An operator that steers by velocity has that followed and the path wait.

    Args:
        path, body, request, safety: read.
        command: written.
        path_age_max_ns: of a path when it is taken up.
        config: parameters.
    """

    def __init__(
        self,
        path: Path,
        body: BodyState,
        request: OperatorRequest,
        safety: SafetyStatus,
        command: BodyCommand,
        path_age_max_ns: int,
        config: TrackerConfig | None = None,
    ) -> None:
        self.name = "tracker"
        self.config = config or TrackerConfig()
        self._path, self._body, self._command = path, body, command
        self._request, self._safety = request, safety
        self._state = TrackerState("/ugv/state/tracker", path.sizes)
        self._followed = FollowedPath(self._state, Polyline, path_age_max_ns)
        self.reads = (path, body, request, safety)
        self.writes = (command,)
        self.state = self._state

    def restore(self, data: bytes | memoryview) -> None:
        """Take up a saved state, and the path in it."""
        super().restore(data)
        self._followed.recall()

    def step(self, now_ns: int) -> None:
        """Track the path from the present body state."""
        state, command = self._state, self._command
        if self._followed.take(self._path, self._request, now_ns):
            state.arrived = state.turning = False
            state.progress = -1.0 if state.count else 0.0
        dt = (now_ns - state.stamp_ns) * 1e-9 if state.stamp_ns else 0.0
        dt = min(max(dt, 0.0), self.config.longest_step_s)
        body = self._body
        relied_on = body.course_velocity, body.angular_velocity, body.plane_normal
        pose = planar_pose(body.position, body.orientation, *relied_on)
        command.clear()
        command.stamp_ns = now_ns
        command.rejected_paths, command.foreign_paths = state.rejected_paths, state.foreign_paths
        if pose is None:
            self._halt()
        elif self._request.steering == Steering.VELOCITY:
            wanted = wanted_velocity(self._request, now_ns, self.config.velocity, self.config.speed)
            self._roam(pose, REST if self._halted else wanted, dt)
        elif self._followed.line is None:
            self._roam(pose, REST, dt)
        else:
            self._track(self._followed.line, pose, dt)
        state.stamp_ns = now_ns

    @property
    def _halted(self) -> bool:
        """Whether the robot is to slow to a stand."""
        asked = self._safety.mode == Mode.ACTIVE and self._request.motion != Motion.WALK
        return asked or self._safety.halt != 0

    def _halt(self) -> None:
        """Command rest at once, holding the heading."""
        state, command = self._state, self._command
        state.speed = state.lateral = state.yaw_rate = 0.0
        command.heading = state.heading
        command.progress = max(state.progress, 0.0)
        command.arrived = state.arrived

    def _roam(self, pose: tuple[float, float, float], wanted: PlanarVelocity, dt: float) -> None:
        """Follow a velocity; at rest, hold the heading."""
        state, command = self._state, self._command
        present = PlanarVelocity(state.speed, state.lateral, state.yaw_rate)
        present = approached(present, wanted, self.config.speed, dt)
        state.speed, state.lateral, state.yaw_rate = present
        state.turning, state.trim = False, 0.0
        if any(present) or not state.oriented:
            state.heading, state.oriented = pose[2], True
        command.velocity[0], command.velocity[1], command.yaw_rate = present
        command.heading = state.heading
        command.progress = max(state.progress, 0.0)
        command.arrived = state.arrived

    def _track(self, line: Polyline, pose: tuple[float, float, float], dt: float) -> None:
        state, command, config = self._state, self._command, self.config
        x, y, yaw = pose
        fresh = state.progress < 0.0
        window = config.start_window_m if fresh else config.search_window_m
        closest = line.closest(x, y, max(state.progress, 0.0), window, beyond_goal=True)
        travelled = 0.0 if fresh else closest.progress - state.progress
        state.progress = closest.progress
        remaining = line.length - closest.progress
        state.arrived = bool(state.arrived) or remaining <= config.speed.goal_tolerance_m

        rate = self._error_rate(closest.lateral_error, dt, fresh)
        along = self._along_path(closest)
        look_ahead = config.look_ahead(closest.lateral_error, rate, min(max(along, 0.0), config.speed.maximum_mps))
        target = line.look_ahead_point(x, y, closest.progress, look_ahead.distance)

        command.look_ahead, command.k_v, command.k_w = look_ahead
        command.target[:] = target
        command.lateral_error = closest.lateral_error
        command.heading_error = wrapped(yaw - closest.heading)
        command.progress = min(closest.progress, line.length)
        command.remaining = max(remaining, 0.0)
        command.arrived = state.arrived
        if state.arrived:
            state.speed = state.lateral = state.yaw_rate = 0.0
        else:
            stretch = surface_stretch(self._body.plane_normal.tolist(), closest.heading)
            self._drive(pose, target, remaining, along * stretch, travelled * stretch, dt)
            state.heading, state.oriented = yaw, True
        command.heading = state.heading

    def _drive(
        self,
        pose: tuple[float, float, float],
        target: tuple[float, float],
        remaining: float,
        measured: float,
        travelled: float,
        dt: float,
    ) -> None:
        """Speed and yaw rate towards the target; `measured` and `travelled` are along the surface."""
        state, command, config = self._state, self._command, self.config
        limits = config.speed
        x, y, yaw = pose
        off = bearing(x, y, yaw, target)
        state.turning = needs_turn(bool(state.turning), off, config.turn)
        curvature = pursuit_curvature(x, y, yaw + self._drift(yaw, dt), target)
        if state.turning or self._halted:
            wanted, cruise = 0.0, False
        else:
            regulated = regulated_speed(state.path_speed, curvature, limits)
            wanted = approach_speed(regulated, remaining, limits)
            cruise = wanted == state.path_speed == state.speed
        reachable = max(measured, 0.0) + limits.lead_mps
        if cruise and dt > 0.0:
            state.trim = next_trim(state.trim, state.speed, travelled, dt, limits)
        state.speed = ramped(
            state.speed, min(wanted, reachable), limits.acceleration_mps2, limits.deceleration_mps2, dt
        )
        turn = max(state.speed, 0.0) * curvature
        if state.turning:
            turn = 0.0 if self._halted else turn_rate(off, config.turn)
        bound = limits.maximum_yaw_rate_radps
        change = limits.yaw_acceleration_radps2
        state.yaw_rate = ramped(state.yaw_rate, min(max(turn, -bound), bound), change, change, dt)
        state.lateral = ramped(state.lateral, 0.0, limits.acceleration_mps2, limits.deceleration_mps2, dt)
        command.velocity[0], command.velocity[1] = state.speed * (1.0 + state.trim), state.lateral
        command.yaw_rate = state.yaw_rate

    def _error_rate(self, lateral_error: float, dt: float, fresh: bool) -> float:
        """Filtered derivative of the magnitude of the lateral error, m/s."""
        state = self._state
        size, time_constant = abs(lateral_error), self.config.error_filter_s
        state.error_magnitude = size if fresh else low_pass(state.error_magnitude, size, dt, time_constant)
        return (size - state.error_magnitude) / time_constant

    def _along_path(self, closest: ClosestPoint) -> float:
        """Measured horizontal speed along the path, m/s."""
        vx, vy = self._body.course_velocity.tolist()
        return float(vx * math.cos(closest.heading) + vy * math.sin(closest.heading))

    def _drift(self, yaw: float, dt: float) -> float:
        """Filtered angle from the heading to the course; fades to zero where there is no course to speak of."""
        state, config = self._state, self.config
        vx, vy = self._body.course_velocity.tolist()
        sample = 0.0
        if math.hypot(vx, vy) >= config.drift_minimum_mps and not state.turning:
            sample = drift_angle((vx, vy), yaw, float(self._body.angular_velocity[2]), config.course_lag_s)
            if abs(sample) > math.pi / 2:
                sample = 0.0
        sample = min(max(sample, -config.drift_limit_rad), config.drift_limit_rad)
        state.drift = low_pass(state.drift, sample, dt, config.drift_filter_s)
        return state.drift
