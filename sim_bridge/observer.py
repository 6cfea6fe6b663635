# SPDX-License-Identifier: Apache-2.0
"""Who watches a simulated run: samples the true robot, gives the push, and says when the run is over."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from runtime.records import Record
from runtime.robots import topics
from runtime.signals import Fault, Mode, SafetyStatus
from sim_bridge.scenario import TIME_FACTOR, Scenario
from sim_bridge.script import WALK_NS
from sim_bridge.simulation import Simulation
from sim_bridge.world import World

Progress = Callable[[float, float], None]
"""Called with the virtual time reached and the time expected, s."""
SAMPLE_NS = 10_000_000
FALLEN_TILT_RAD = 1.0
STOPPED_FOR_NS = 700_000_000
SETTLE_AFTER_FAULT_NS = 500_000_000


class Observer:
    """Watches the true robot, gives the push, and says when the run is over.

    Args:
        world: the true robot.
        records: by topic, what the robot's loops write, or copies that are kept up to date.
        simulation, scenario: of the run.
        until_s: ends the run by then.
        progress: called now and then.

    Attributes:
        samples: time (s), x, y (m) and yaw (rad) of the true trunk, from when it may walk.
        fell, fault: whether it fell, and why it was damped.
        broken: what then was broken, in words.
        push_end_s: when the push's force ended, None before there was one.
        limit_ns: the run ends by then.
    """

    def __init__(
        self,
        world: World,
        records: Mapping[str, Record],
        simulation: Simulation,
        scenario: Scenario,
        until_s: float,
        progress: Progress | None,
    ) -> None:
        self._world, self._scenario, self._simulation, self._progress = world, scenario, simulation, progress
        self._safety: SafetyStatus = records[topics.SAFETY]  # type: ignore[assignment]
        self._finished = simulation.finished(scenario, records)
        self._records = records
        self.samples: list[tuple[float, float, float, float]] = []
        self.fell, self.fault = False, Fault.NONE
        self.broken: Sequence[str] = ()
        self.push_end_s: float | None = None
        self.limit_ns = WALK_NS + int((scenario.time_limit_s + 3.0) * 1e9)
        expected_s = self.limit_ns * 1e-9 / TIME_FACTOR
        if until_s < self.limit_ns * 1e-9:
            self.limit_ns = int(until_s * 1e9)
        self._expected_s = min(expected_s, until_s)
        self._end_ns = self.limit_ns
        self._pushed = scenario.push is None
        self._stood = False
        self._next_ns = 0

    def over(self, now_ns: int) -> bool:
        """Look at the robot; true when there is nothing more to see."""
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + SAMPLE_NS
        world = self._world
        if now_ns >= WALK_NS or not self._scenario.waypoints:
            self.samples.append((now_ns * 1e-9, *world.position[:2].tolist(), world.yaw))
        if self._progress is not None and len(self.samples) % 25 == 1:
            self._progress(now_ns * 1e-9, self._expected_s)
        if not self.fell and (world.tilt > FALLEN_TILT_RAD or world.clearance < self._simulation.fallen_clearance_m):
            self.fell = bool(self._scenario.waypoints) or world.tilt > FALLEN_TILT_RAD
        mode = self._safety.mode
        if mode == Mode.DAMPED and not self.fault:
            self.fault = Fault(self._safety.fault)
            self.broken = self._simulation.broken(self._records)
        if mode in (Mode.OFF, Mode.STANDBY) and self._scenario.waypoints and now_ns >= WALK_NS and not self.fault:
            self.fault = Fault(self._safety.warning)
        if self.fell or self.fault:
            self._end_ns = min(self._end_ns, now_ns + SETTLE_AFTER_FAULT_NS)
        if self._finished():
            self._end_ns = min(self._end_ns, now_ns + STOPPED_FOR_NS)
        if not self._scenario.waypoints:
            self._stood |= mode == Mode.STANDING
            if self._stood and mode == Mode.STANDBY:
                self._end_ns = min(self._end_ns, now_ns + STOPPED_FOR_NS)
        if not self._pushed:
            self._push(now_ns)
        return now_ns >= self._end_ns

    def _push(self, now_ns: int) -> None:
        """Schedule the push when its time has come."""
        push = self._scenario.push
        assert push is not None
        if now_ns < WALK_NS + int(push.after_s * 1e9):
            return
        at_ns = self._simulation.push_ns(push, self._records, now_ns)
        if at_ns is None:
            return
        self._world.push(at_ns, int(push.duration_s * 1e9), push.direction_rad, push.force_n)
        self._pushed, self.push_end_s = True, at_ns * 1e-9 + push.duration_s

    @property
    def stood_and_sat(self) -> bool:
        """For scenarios without a path: it stood up and sat down again, without a fault."""
        return self._stood and self._safety.mode == Mode.STANDBY and not self.fell
