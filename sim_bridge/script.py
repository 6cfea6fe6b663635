# SPDX-License-Identifier: Apache-2.0
"""The operator of a simulated run: arms the robot, has it stand up, gives it the path, has it sit down again."""

from __future__ import annotations

from runtime.records import Record
from runtime.signals import Motion, OperatorRequest, Path
from sim_bridge.courses import Scenario

ARM_NS = 10_000_000
WALK_NS = 600_000_000
"""A robot that stands from the start is ready by then."""
PERIOD_NS = 100_000_000
"""Between two signs of life."""


class ScriptedOperator:
    """Input port of the operator's requests.

    Args:
        scenario: what to run; one without a path stands for its time and sits down.
        rise_s: duration of standing up.
    """

    def __init__(self, scenario: Scenario, rise_s: float) -> None:
        self._walks = bool(scenario.waypoints)
        self._sit_ns = ARM_NS + int((rise_s + scenario.stand_s) * 1e9)
        self._next_ns = 0
        self._last = -1

    def motion(self, now_ns: int) -> Motion:
        """What is asked for at a time."""
        if now_ns < ARM_NS:
            return Motion.REST
        if self._walks:
            return Motion.STAND if now_ns < WALK_NS else Motion.WALK
        return Motion.STAND if now_ns < self._sit_ns else Motion.SIT

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the request, when it changes and as a sign of life."""
        assert isinstance(record, OperatorRequest)
        motion = self.motion(now_ns)
        if motion == self._last and now_ns < self._next_ns:
            return False
        self._last, self._next_ns = motion, now_ns + PERIOD_NS
        record.stamp_ns, record.motion, record.arm = now_ns, motion, motion != Motion.REST
        return True


class ScriptedPath:
    """Input port of the path, given once when the robot is to walk."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, self._given = scenario, not scenario.waypoints

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the path."""
        assert isinstance(record, Path)
        if self._given or now_ns < WALK_NS:
            return False
        self._given = True
        scenario = self._scenario
        count = len(scenario.waypoints)
        record.stamp_ns, record.count = now_ns, count
        record.closed, record.speed = scenario.closed, scenario.speed_mps
        record.x[:count], record.y[:count] = zip(*scenario.waypoints, strict=True)
        return True
