# SPDX-License-Identifier: Apache-2.0
"""The task that steers a vehicle: from a path, or a velocity asked for, to a motion of the vehicle's centre."""

from __future__ import annotations

from collections.abc import Callable

from runtime.models.vehicle import VehicleGeometry
from runtime.signals import Mode, Motion, OperatorRequest, Path, SafetyStatus, Steering
from runtime.tasks import Task
from runtime.tracking import motion
from runtime.tracking.drive_tracker_config import DriveTrackerConfig, DriveTrackerMemory, SolveMemory
from runtime.tracking.followed_path import FollowedPath
from runtime.tracking.inputs import planar_pose
from runtime.tracking.path_speed import SpeedPolicy
from runtime.tracking.traction import next_lost, slides
from runtime.tracking.vehicle_tracker import SteeringPolicy, TrackCommand, VehicleTracker
from runtime.tracking.velocity import REST, PlanarVelocity, approached, wanted_velocity
from runtime.tracking.wheel_motion import centre_angle
from runtime.vehicle_signals import CommandDelay, SteeringMode, TwistCommand, VehicleState, WheelState


class DriveTracker(Task):
    """Follows a path with a `VehicleTracker`, or a velocity that the operator asks for.

    A path is run from its start, to its goal, once: the same waypoints sent again only change the speed, and are run
    again only after a withdrawal. The vehicle slows to a stand, and goes on from there, when safety asks for it, when
    it is not asked to drive, or when there is no path any more. A velocity that no path is driven with, sideways or
    turning in place, comes to rest before a path is followed. While the estimate is not finite the vehicle is to stand.
    What is steered from is the pose at which the wheels will answer. Where the vehicle slides it counts on less grip.

    Args:
        config: parameters.
        geometry: of the vehicle.
        policy: makes what says which arc to drive, given its memory.
        speed: how fast to drive it; None for as fast as bends and the goal allow.
        path, body, wheels, delay, request, safety: records read.
        command: record written.
        path_age_max_ns: of a path when it is taken up.
    """

    name = "tracker"

    def __init__(
        self,
        config: DriveTrackerConfig,
        geometry: VehicleGeometry,
        policy: Callable[[SolveMemory], SteeringPolicy],
        speed: SpeedPolicy | None,
        path: Path,
        body: VehicleState,
        wheels: WheelState,
        delay: CommandDelay,
        request: OperatorRequest,
        safety: SafetyStatus,
        command: TwistCommand,
        path_age_max_ns: int,
    ) -> None:
        self._config, self._path, self._body, self._wheels, self._delay = config, path, body, wheels, delay
        self._geometry = geometry
        self._request, self._safety, self._command = request, safety, command
        self.reads, self.writes = (path, body, wheels, delay, request, safety), (command,)
        self.state: DriveTrackerMemory = DriveTrackerMemory("/ugv/state/tracker", path.sizes)
        self._tracker = VehicleTracker(policy(self.state), config.following, self.state.tracked, speed)
        self._tracker.forget()
        self._followed = FollowedPath(self.state, self._tracker.take, path_age_max_ns)

    def restore(self, data: bytes | memoryview) -> None:
        """Take up a saved state, and the path in it."""
        super().restore(data)
        self._followed.recall()

    def step(self, now_ns: int) -> None:
        """One command; see `Task`."""
        memory, command = self.state, self._command
        if self._followed.take(self._path, self._request, now_ns):
            memory.arrived, memory.progress = False, 0.0
            self._tracker.begin()
        body = self._body
        pose = planar_pose(body.position, body.orientation, body.velocity, body.angular_velocity)
        memory.lost = self._lost(now_ns)
        command.clear()
        command.grip = 1.0 - memory.lost
        command.stamp_ns = now_ns
        command.rejected_paths, command.foreign_paths = memory.rejected_paths, memory.foreign_paths
        if pose is None:
            self._move(REST, now_ns)
        elif self._request.steering == Steering.VELOCITY:
            wanted = wanted_velocity(self._request, now_ns, self._config.velocity, self._config.following.speed)
            self._roam(REST if self._halted else wanted, now_ns)
        elif self._followed.line is None or self._off_arc:
            self._roam(REST, now_ns)
        else:
            self._follow(pose, now_ns)
        command.velocity[0], command.velocity[1] = memory.forward, memory.lateral
        command.yaw_rate, command.manner = memory.yaw_rate, memory.manner
        command.progress, command.arrived = memory.progress, memory.arrived
        command.residual, command.failures = float(memory.residual[0]), int(memory.failures[0])
        memory.stamp_ns = now_ns

    @property
    def _halted(self) -> bool:
        """Whether the vehicle is to slow to a stand."""
        drives = self._safety.mode == Mode.ACTIVE and self._request.motion == Motion.WALK
        return not drives or self._safety.halt != 0

    def _step_s(self, now_ns: int) -> float:
        """Time since the last step, s; 0 in the first, and of a longer gap only the part that counts."""
        stamp_ns = self.state.stamp_ns
        dt = (now_ns - stamp_ns) * 1e-9 if stamp_ns else 0.0
        return min(dt, self._config.following.longest_step_s)

    def _lost(self, now_ns: int) -> float:
        """The share of the accelerations that cannot be counted on for how the vehicle slides."""
        memory, config, body = self.state, self._config.traction, self._body
        asked_mps2 = memory.forward * memory.yaw_rate
        sliding = slides(body.velocity.tolist(), body.slip.tolist(), asked_mps2, config)
        return next_lost(
            memory.lost,
            sliding and memory.manner == SteeringMode.ACKERMANN,
            self._step_s(now_ns),
            config,
        )

    def _roam(self, wanted: PlanarVelocity, now_ns: int) -> None:
        """Follow a velocity."""
        memory = self.state
        present = PlanarVelocity(memory.forward, memory.lateral, memory.yaw_rate)
        self._move(approached(present, wanted, self._config.following.speed, self._step_s(now_ns)), now_ns)
        memory.manner = manner_of(wanted, memory.manner)

    def _move(self, velocity: PlanarVelocity, now_ns: int) -> None:
        """Ask for a velocity, and have the path's tracker know."""
        memory = self.state
        memory.forward, memory.lateral, memory.yaw_rate = velocity
        memory.roaming = True
        self._tracker.note(now_ns * 1e-9, velocity.forward, curvature_of(velocity))

    @property
    def _off_arc(self) -> bool:
        """Whether a velocity is still asked for that no path is driven with."""
        memory = self.state
        turns = memory.yaw_rate != 0.0 and memory.manner != SteeringMode.ACKERMANN
        return bool(memory.roaming) and (memory.lateral != 0.0 or turns)

    def _follow(self, pose: tuple[float, float, float], now_ns: int) -> None:
        """Follow the path."""
        memory, command = self.state, self._command
        forward, yaw_rate = float(self._body.velocity[0]), float(self._body.angular_velocity[2])
        angle = centre_angle(self._wheels.steering, self._geometry)
        moving = motion.Motion(*pose, forward, angle, yaw_rate)
        wanted = self._tracker.step(
            now_ns * 1e-9, moving, memory.path_speed, self._delay.delay, self._halted, command.grip
        )
        memory.forward, memory.lateral, memory.yaw_rate = wanted.speed, 0.0, wanted.yaw_rate
        memory.manner = SteeringMode.SPIN if wanted.turning else SteeringMode.ACKERMANN
        memory.arrived, memory.progress, memory.roaming = wanted.arrived, wanted.progress, False
        _tell(wanted, command)


def _tell(wanted: TrackCommand, command: TwistCommand) -> None:
    """What is good to know of a command."""
    command.predicted, command.target, command.look_ahead = wanted.pose, wanted.target, wanted.look_ahead
    command.lateral_error, command.heading_error = wanted.lateral_error, wanted.heading_error
    command.remaining = wanted.remaining


def manner_of(wanted: PlanarVelocity, present: int) -> int:
    """The way of steering that suits a velocity; at rest it stays as it is."""
    forward, lateral, yaw_rate = (value != 0.0 for value in wanted)
    if not (forward or lateral or yaw_rate):
        return present
    if not lateral:
        return SteeringMode.ACKERMANN if forward else SteeringMode.SPIN
    return SteeringMode.FREE if yaw_rate else SteeringMode.CRAB


def curvature_of(velocity: PlanarVelocity) -> float | None:
    """Curvature, 1/m, that a velocity steers the wheels for; None at rest, where they stay as they are.

    Sideways, or turning in place, front and rear wheels are not turned against each other as on an arc: that is none.
    """
    if velocity == REST:
        return None
    return velocity.yaw_rate / velocity.forward if velocity.forward else 0.0
