# SPDX-License-Identifier: Apache-2.0
"""Walking for long: lap after lap, and after each fall into DAMPED a reset, a new arm, and on again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import Any

from runtime.errors import UsageError
from runtime.recording.metrics import GOAL_TOLERANCE_M
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import (
    Fault,
    Mode,
    Motion,
    OperatorEvent,
    OperatorRequest,
    Path,
    Request,
    SafetyStatus,
)
from sim_bridge.observer import FALLEN_TILT_RAD, SAMPLE_NS
from sim_bridge.scenario import Scenario
from sim_bridge.script import PERIOD_NS, PRIORITY, SOURCE
from sim_bridge.simulation import Simulation
from sim_bridge.world import World

WATCHED = (topics.SAFETY, topics.BODY_COMMAND, topics.OPERATOR)
RESTED_NS = 1_000_000_000
"""A damped robot lies still by then."""
_POWERED = (Mode.STANDING, Mode.ACTIVE)


def check_has_laps(scenario: Scenario) -> None:
    """See that there is a path to follow lap after lap.

    Raises:
        UsageError: if the robot stands, goes by the operator's velocity, or ends elsewhere than it began.
    """
    told = "ugv sil: --duration is for scenarios with a path"
    if not len(scenario.waypoints) or scenario.velocity is not None:
        raise UsageError(f"{told} to follow, and {scenario.name} has none")
    ends = scenario.waypoints[0], scenario.waypoints[-1]
    if not scenario.closed and math.dist(*ends) > GOAL_TOLERANCE_M:
        raise UsageError(f"{told} that leads back to its start, and that of {scenario.name} does not")


class Aim(Enum):
    """What the operator is about to bring the robot to."""

    STAND = auto()
    WALK = auto()
    WALKING = auto()
    WITHDRAW = auto()
    RESET = auto()


class EnduringOperator:
    """Input ports of the operator's events and of the path, by what the robot shows.

    Args:
        scenario: whose path is walked, lap after lap.
        records: of the robot, by topic, kept up to date.
        ready: whether a robot that stands can go.

    Attributes:
        ready: as given.
        laps: completed.
        falls: into DAMPED: world time, s, and the names of the faults.
    """

    def __init__(self, scenario: Scenario, records: Mapping[str, Record], ready: Callable[[], bool]) -> None:
        self._scenario, self.ready = scenario, ready
        self._safety: SafetyStatus = records[topics.SAFETY]  # type: ignore[assignment]
        self._command: Any = records[topics.BODY_COMMAND]
        self._operator: OperatorRequest = records[topics.OPERATOR]  # type: ignore[assignment]
        self.laps = 0
        self.falls: list[tuple[float, str]] = []
        self._aim = Aim.STAND
        self._rested_ns = self._next_ns = self._next_path_ns = 0
        self._sequence = 0

    def look(self, now_ns: int) -> None:
        """See how far the robot has come."""
        mode, command = self._safety.mode, self._command
        if mode == Mode.DAMPED and self._aim is not Aim.RESET:
            self.falls.append((now_ns * 1e-9, str(Fault(self._safety.fault).name)))
            self._aim, self._rested_ns = Aim.RESET, now_ns + RESTED_NS
        elif mode in (Mode.OFF, Mode.STANDBY):
            self._aim = Aim.STAND  # after a reset, or since control was started anew
        elif self._aim is Aim.STAND and mode == Mode.STANDING and self.ready():
            self._aim = Aim.WITHDRAW
        elif self._aim is Aim.WITHDRAW and not command.arrived and command.remaining == 0.0:
            self._aim = Aim.WALK
        elif self._aim is Aim.WALK and command.remaining > 0.0:
            self._aim = Aim.WALKING
        elif self._aim is Aim.WALKING and command.arrived:
            self.laps += 1
            self._aim = Aim.WITHDRAW

    def request(self, now_ns: int) -> tuple[Request, Motion]:
        """What to ask for at a time."""
        wanted, operator = self._wanted_motion(), self._operator
        if self._aim is Aim.RESET:
            if operator.arm:
                return Request.DISARM, Motion.REST
            return (Request.RESET if now_ns >= self._rested_ns else Request.LIFE), Motion.REST
        if operator.motion != wanted:
            return Request.MOTION, wanted
        return (Request.LIFE if operator.arm else Request.ARM), wanted

    def _wanted_motion(self) -> Motion:
        return Motion.STAND if self._aim in (Aim.STAND, Aim.RESET) else Motion.WALK

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the next event."""
        assert isinstance(record, OperatorEvent)
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + PERIOD_NS
        self._sequence += 1
        record.stamp_ns, record.sequence, record.source, record.priority = now_ns, self._sequence, SOURCE, PRIORITY
        record.request, record.motion = self.request(now_ns)
        return True

    def read_path(self, record: Record, now_ns: int) -> bool:
        """Give the path, or withdraw it, until that has been taken up."""
        assert isinstance(record, Path)
        if self._aim not in (Aim.WITHDRAW, Aim.WALK) or now_ns < self._next_path_ns:
            return False
        self._next_path_ns = now_ns + 4 * PERIOD_NS
        record.clear()
        record.stamp_ns, record.source, record.speed = now_ns, SOURCE, self._scenario.speed_mps
        if self._aim is Aim.WALK:
            waypoints = self._scenario.waypoints
            record.count, record.closed = len(waypoints), self._scenario.closed
            record.x[: len(waypoints)], record.y[: len(waypoints)] = zip(*waypoints, strict=True)
        return True


class EnduringPath:
    """The path port of an `EnduringOperator`."""

    def __init__(self, operator: EnduringOperator) -> None:
        self._operator = operator

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the path, or withdraw it."""
        return self._operator.read_path(record, now_ns)


class EnduranceObserver:
    """Watches a long walk.

    Args:
        simulation, world: the true robot.
        operator: told to look at each sample.
        records: of the robot, by topic, kept up to date.
        duration_s: of the walk.
        progress: called now and then, told the present mode too.
    """

    def __init__(
        self,
        simulation: Simulation,
        world: World,
        operator: EnduringOperator,
        records: Mapping[str, Record],
        duration_s: float,
        progress: Callable[[float, float, Mode], None],
    ) -> None:
        self._simulation, self._world, self._operator, self._progress = simulation, world, operator, progress
        self._safety: SafetyStatus = records[topics.SAFETY]  # type: ignore[assignment]
        self._duration_s, self._next_ns, self._samples = duration_s, 0, 0
        self._stood = self._tipped = False
        self._tumbles = 0

    def over(self, now_ns: int) -> bool:
        """Look at the robot; true when the time is over."""
        self._operator.look(now_ns)
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + SAMPLE_NS
        self._samples += 1
        if self._samples % 100 == 1:
            self._progress(now_ns * 1e-9, self._duration_s, Mode(self._safety.mode))
        self._look_for_tumbles()
        return now_ns >= self._duration_s * 1e9

    def _look_for_tumbles(self) -> None:
        """A robot that rises from the ground has not fallen onto it, but may tip over."""
        lies, tipped = self._world.clearance < self._simulation.fallen_clearance_m, self._world.tilt > FALLEN_TILT_RAD
        powered = self._safety.mode in _POWERED
        self._tumbles += powered and ((tipped and not self._tipped) or (lies and self._stood))
        self._tipped = tipped
        self._stood = powered and not lies and not tipped and (self._stood or self._operator.ready())

    def outcome(self) -> dict[str, Any]:
        """How the walk went; `tumbles` are falls of a robot that was not damped."""
        operator = self._operator
        return {
            "completed": operator.laps > 0 and not self._tumbles,
            "fell": self._tumbles > 0,
            "fault": "",
            "laps": operator.laps,
            "tumbles": self._tumbles,
            "falls_into_damped": [{"at_s": at_s, "fault": fault} for at_s, fault in operator.falls],
        }
