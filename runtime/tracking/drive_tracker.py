# SPDX-License-Identifier: Apache-2.0
"""The tracking task of a vehicle: from a path and the estimate to a motion of its centre."""

from __future__ import annotations

import math
from collections.abc import Callable

from runtime.models.rotations import wrapped
from runtime.signals import Mode, Motion, OperatorRequest, Path, SafetyStatus, Steering
from runtime.tasks import Task
from runtime.tracking.delay import PlanarPose, after_delay, remember
from runtime.tracking.drive_tracker_config import DriveTrackerConfig, DriveTrackerMemory
from runtime.tracking.followed_path import FollowedPath
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.pure_pursuit import bearing
from runtime.tracking.speed import approach_speed, ramped, regulated_speed
from runtime.tracking.turn import needs_turn, turn_rate
from runtime.tracking.velocity import REST, PlanarVelocity, approached, wanted_velocity
from runtime.tracking.waypoint_pursuit import Pursuit
from runtime.vehicle_signals import SteeringMode, TwistCommand, VehicleState

Controller = Callable[[Polyline, PlanarPose, ClosestPoint], Pursuit]
"""Which arc to drive from a pose (x, y, yaw) whose closest point of the path is known."""


class DriveTracker(Task):
    """Follows a path, or a velocity that the operator asks for, as `PathTracker` does on legs.

    A path is run from its start, to its goal, once. The vehicle slows to a stand, and goes on from there, when safety
    asks for it, when it is not asked to drive, or when there is no path any more. Where the path leads back behind it,
    it turns in place first. The controller is asked for the arc at the pose that the command will find.

    Args:
        config: parameters.
        controller: pursues the path.
        period_ns: between steps.
        path, body, request, safety: records read.
        command: record written.
    """

    name = "tracker"

    def __init__(
        self,
        config: DriveTrackerConfig,
        controller: Controller,
        period_ns: int,
        path: Path,
        body: VehicleState,
        request: OperatorRequest,
        safety: SafetyStatus,
        command: TwistCommand,
    ) -> None:
        self._config, self._controller, self._period_s = config, controller, period_ns * 1e-9
        self._path, self._body, self._request, self._safety, self._command = path, body, request, safety, command
        self.reads, self.writes = (path, body, request, safety), (command,)
        self.state: DriveTrackerMemory = DriveTrackerMemory("/ugv/state/tracker", path.sizes)
        self._followed = FollowedPath(self.state)

    def restore(self, data: bytes | memoryview) -> None:
        """Take up a saved state, and the path in it."""
        super().restore(data)
        self._followed.recall()

    def step(self, now_ns: int) -> None:
        """One command; see `Task`."""
        memory, command, config = self.state, self._command, self._config
        if self._followed.take(self._path):
            memory.arrived = memory.turning = False
            memory.progress = -1.0 if memory.count else 0.0
        dt = (now_ns - memory.stamp_ns) * 1e-9 if memory.stamp_ns else 0.0
        dt = min(max(dt, 0.0), config.longest_step_s)
        pose, line = pose_of(self._body), self._followed.line
        command.clear()
        command.stamp_ns, command.rejected_paths = now_ns, memory.rejected_paths
        if pose is None:
            memory.speed = memory.lateral = memory.yaw_rate = 0.0
        elif self._request.steering == Steering.VELOCITY:
            wanted = wanted_velocity(self._request, now_ns, config.velocity, config.speed)
            self._roam(REST if self._halted else wanted, dt)
        elif line is None:
            self._roam(REST, dt)
        else:
            self._track(line, pose, dt)
        self._publish(now_ns)

    @property
    def _halted(self) -> bool:
        """Whether the vehicle is to slow to a stand."""
        drives = self._safety.mode == Mode.ACTIVE and self._request.motion == Motion.WALK
        return not drives or self._safety.halt != 0

    def _publish(self, now_ns: int) -> None:
        memory, command = self.state, self._command
        command.velocity[0], command.velocity[1] = memory.speed, memory.lateral
        command.yaw_rate, command.manner = memory.yaw_rate, memory.manner
        command.progress, command.arrived = max(command.progress, memory.progress, 0.0), memory.arrived
        remember(memory, memory.speed, memory.lateral, memory.yaw_rate)
        memory.stamp_ns = now_ns

    def _roam(self, wanted: PlanarVelocity, dt: float) -> None:
        """Follow a velocity."""
        memory = self.state
        present = PlanarVelocity(memory.speed, memory.lateral, memory.yaw_rate)
        memory.speed, memory.lateral, memory.yaw_rate = approached(present, wanted, self._config.speed, dt)
        memory.turning, memory.manner = False, manner_of(wanted, memory.manner)

    def _track(self, line: Polyline, pose: PlanarPose, dt: float) -> None:
        memory, command, config = self.state, self._command, self._config
        window = config.start_window_m if memory.progress < 0.0 else config.search_window_m
        closest = line.closest(pose[0], pose[1], max(memory.progress, 0.0), window, beyond_goal=True)
        memory.progress = closest.progress
        remaining = line.length - closest.progress
        memory.arrived = bool(memory.arrived) or remaining <= config.speed.goal_tolerance_m

        predicted = after_delay(pose, memory, config.delay_s, self._period_s)
        ahead = line.closest(predicted[0], predicted[1], closest.progress, window, beyond_goal=True)
        pursuit = self._controller(line, predicted, ahead)

        command.predicted, command.target, command.look_ahead = predicted, pursuit.target, pursuit.look_ahead
        command.lateral_error = closest.lateral_error
        command.heading_error = wrapped(pose[2] - closest.heading)
        command.remaining = max(remaining, 0.0)
        if memory.arrived:
            memory.speed = memory.lateral = memory.yaw_rate = 0.0
        else:
            self._drive(pursuit, bearing(*predicted, pursuit.target), remaining, dt)

    def _drive(self, pursuit: Pursuit, off: float, remaining: float, dt: float) -> None:
        """Speed and yaw rate along the arc, or the yaw rate of a turn in place."""
        memory, limits = self.state, self._config.speed
        memory.turning = needs_turn(bool(memory.turning), off, self._config.turn)
        bound = self._config.curvature_max_pm
        curvature = min(max(pursuit.curvature, -bound), bound)
        wanted = 0.0
        if not (memory.turning or self._halted):
            wanted = approach_speed(regulated_speed(memory.path_speed, curvature, limits), remaining, limits)
        reachable = max(float(self._body.velocity[0]), 0.0) + limits.lead_mps
        up, down = limits.acceleration_mps2, limits.deceleration_mps2
        memory.speed = ramped(memory.speed, min(wanted, reachable), up, down, dt)
        memory.lateral = ramped(memory.lateral, 0.0, up, down, dt)
        memory.yaw_rate, memory.manner = memory.speed * curvature, SteeringMode.ACKERMANN
        if memory.turning and memory.speed <= 0.0:
            memory.yaw_rate = 0.0 if self._halted else turn_rate(off, self._config.turn)
            memory.manner = SteeringMode.SPIN


def pose_of(body: VehicleState) -> PlanarPose | None:
    """Position and yaw, or None where the estimate is not finite or was never written."""
    x, y, _ = body.position.tolist()
    i, j, k, w = body.orientation.tolist()
    values = (x, y, i, j, k, w, *body.velocity.tolist())
    if not all(map(math.isfinite, values)) or i * i + j * j + k * k + w * w < 0.25:
        return None
    return x, y, math.atan2(2.0 * (w * k + i * j), w * w + i * i - j * j - k * k)


def manner_of(wanted: PlanarVelocity, present: int) -> int:
    """The way of steering that suits a velocity; at rest it stays as it is."""
    forward, lateral, yaw_rate = (value != 0.0 for value in wanted)
    if not (forward or lateral or yaw_rate):
        return present
    if not lateral:
        return SteeringMode.ACKERMANN if forward else SteeringMode.SPIN
    return SteeringMode.FREE if yaw_rate else SteeringMode.CRAB
