# SPDX-License-Identifier: Apache-2.0
"""The operator of a simulated run: arms the robot, has it stand up, gives it the path, has it sit down again."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from runtime.records import Record
from runtime.signals import Motion, OperatorEvent, Path, Request
from sim_bridge.scenario import Scenario

ARM_NS = 10_000_000
WALK_NS = 600_000_000
"""A robot that stands from the start is ready by then."""
PERIOD_NS = 100_000_000
"""Between two signs of life."""
STAND_NS = ARM_NS - 2_000_000
"""The posture is asked for before the arm, since a port gives one event a tick."""
SOURCE, PRIORITY = 1, 10


class ScriptedEvent(NamedTuple):
    """What the operator says at a time."""

    at_ns: int
    request: Request
    motion: Motion = Motion.REST


class ScriptedOperator:
    """Input port of the operator's events.

    Args:
        scenario: what to run; one without a path stands for its time and sits down.
        rise_s: duration of standing up.
    """

    def __init__(self, scenario: Scenario, rise_s: float) -> None:
        last = Motion.WALK if scenario.waypoints else Motion.SIT
        last_ns = WALK_NS if scenario.waypoints else ARM_NS + int((rise_s + scenario.stand_s) * 1e9)
        self._orders = (
            ScriptedEvent(STAND_NS, Request.MOTION, Motion.STAND),
            ScriptedEvent(ARM_NS, Request.ARM),
            ScriptedEvent(last_ns, Request.MOTION, last),
        )
        self._until_ns = 0
        self._waiting: deque[ScriptedEvent] = deque()
        self._sequence = 0

    def events(self, from_ns: int, until_ns: int) -> list[ScriptedEvent]:
        """What is said from a time until before another: orders, and signs of life."""
        first = -(-from_ns // PERIOD_NS) * PERIOD_NS
        lives = [ScriptedEvent(at_ns, Request.LIFE) for at_ns in range(first, until_ns, PERIOD_NS)]
        orders = [event for event in self._orders if from_ns <= event.at_ns < until_ns]
        return sorted(orders + lives, key=lambda event: event.at_ns)

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the next event."""
        assert isinstance(record, OperatorEvent)
        self._waiting += self.events(self._until_ns, now_ns + 1)
        self._until_ns = now_ns + 1
        if not self._waiting:
            return False
        _, request, motion = self._waiting.popleft()
        self._sequence += 1
        record.clear()
        record.stamp_ns, record.sequence, record.source, record.priority = now_ns, self._sequence, SOURCE, PRIORITY
        record.request, record.motion = request, motion
        return True


class ScriptedPath:
    """Input port of the path, given once when the robot is to walk."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, self._given = scenario, not scenario.waypoints or scenario.velocity is not None

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the path."""
        assert isinstance(record, Path)
        if self._given or now_ns < WALK_NS:
            return False
        self._given = True
        scenario = self._scenario
        count = len(scenario.waypoints)
        record.stamp_ns, record.source, record.count = now_ns, SOURCE, count
        record.closed, record.speed = scenario.closed, scenario.speed_mps
        record.x[:count], record.y[:count] = zip(*scenario.waypoints, strict=True)
        return True
