# SPDX-License-Identifier: Apache-2.0
"""One fault of the computer in one walk in virtual time, judged at the drives, in the log and in /diagnostics."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from runtime.executors.collector import collector_paused
from runtime.executors.lockstep import Lockstep
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.link import topics as ros
from runtime.link.loop import STATUS
from runtime.messages import definitions
from runtime.recording.log import Log
from runtime.robots import assembled, load_configuration, topics
from runtime.robots.robot import Robot
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Fault
from sim_bridge.courses import scenario
from sim_bridge.faults.command_ages import CommandAges
from sim_bridge.faults.computer import CONTROL, STEP_NS, Computer
from sim_bridge.faults.live_judge import moved_unarmed
from sim_bridge.faults.live_logs import LiveLogs
from sim_bridge.faults.log_flaws import missing_log
from sim_bridge.faults.trial import Trial, flaws
from sim_bridge.faults.walk import WALKING_NS, WalkWatch
from sim_bridge.faults.wires import QuadrupedWires
from sim_bridge.faults.witness import Witness
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.run import wire

MS = 1_000_000
LINGER_NS = 500 * MS
SLICE_NS = 20 * MS
"""Control that hangs is looked at so often."""
Inject = Callable[[Computer, QuadrupedWires, int, int], None]
"""Prepares a fault that is there from a time until before another, ns."""


@dataclass(frozen=True)
class ComputerRow:
    """A fault of the computer, and its answer.

    Attributes:
        name: for people.
        inject: prepares it.
        answer: what the robot is to do, in order; see `Row`.
        bound_ns: how soon, of the configuration.
        lasts_ns: how long the fault is there.
        after_ns: how long to go on watching then.
        fault: bits by which it is to be named.
        counted: topic and field of what is to be counted.
        told: what /diagnostics is to say.
        breaks_log: whether ticks are missing while it is there.
        loses: datagrams that may be lost and counted nowhere.
        forced: whether a force from outside may take the joints beyond their limits.
        settings: configuration that shows this answer.
    """

    name: str
    inject: Inject
    answer: tuple[str, ...]
    bound_ns: Callable[[Uslgo1Config], int]
    lasts_ns: int
    after_ns: int = LINGER_NS
    fault: Fault = Fault.NONE
    counted: tuple[str, str] | None = None
    told: str = ""
    breaks_log: bool = False
    loses: int = 0
    forced: bool = False
    settings: dict[str, str] = field(default_factory=dict)

    @property
    def config(self) -> Uslgo1Config:
        """The configuration that it is tried with."""
        config = load_configuration("uslgo1", self.settings)
        assert isinstance(config, Uslgo1Config)
        return config


class _Listener:
    """Somebody who reads /diagnostics."""

    def __init__(self) -> None:
        self.heard = bytearray()

    def receive(self, payload: bytes, attachment: bytes) -> None:
        self.heard += payload

    def refuse(self, reason: str) -> None:
        """Nothing is refused."""


class _Walk:
    """A walk in which something befalls the computer at a phase of the gait that the seed chooses.

    Args:
        row: the fault.
        seed: of the phase, and of what the fault leaves to chance.
        directory: for the runtime directory and the bags; empty.
    """

    def __init__(self, row: ComputerRow, seed: int, directory: Path) -> None:
        config = row.config
        self.row, self.config, self.logs = row, config, directory / "logs"
        rng = np.random.default_rng((seed, *row.name.encode()))
        self.begin_ns = (WALKING_NS + int(rng.integers(config.gait.period_ns))) // STEP_NS * STEP_NS
        self.end_ns = self.begin_ns + row.lasts_ns
        self._wired = wired = wire(config, scenario("flat"), seed)
        assert isinstance(wired.world, QuadrupedWorld)
        self._world = wired.world
        shared = directory / "run"
        shared.mkdir()
        self.computer = computer = Computer(config, wired, seed, shared, self.logs)
        loops = wired.robot.loops
        self._wires = QuadrupedWires(
            config, wired.bus, wired.world, computer.sources, loops, rng, events=computer.events
        )
        self._ages = CommandAges(wired.bus, lambda: computer.clocks.suspended_ns)
        self._outputs = {topics.CAN_SENT: self._ages.noted(computer.outputs[topics.CAN_SENT])}
        self._witness = Witness(config, wired.world, lambda: computer.clocks.world_ns)
        computer.watchers.append(self._look)
        self._driven_again = False
        self._listener = _Listener()
        computer.network.join("somebody").subscribe(ros.DIAGNOSTICS, definitions.DIAGNOSTIC_ARRAY, self._listener)
        assert computer.link is not None
        others = {STATUS: computer.link.carrier.status}
        self._watch = WalkWatch(row, config, wired.robot, wired.world, self.begin_ns, others)
        self._wires.once(self.begin_ns, self._begin)
        row.inject(computer, self._wires, self.begin_ns, self.end_ns)

    def _begin(self) -> None:
        self._witness.begin()
        self._watch.begin()
        self._listener.heard.clear()

    def _look(self) -> None:
        """At every step of the world."""
        self._driven_again |= self._witness.released_ns is not None and self._world.drives.driven
        self._witness.look()

    def run(self, until_ns: int) -> Trial:
        """Walk until a time; control that is killed is started again as another process."""
        robot: Robot | None = self._wired.robot
        with collector_paused(), closing(self.computer):
            while robot is not None and self.computer.clocks.monotonic_ns < until_ns:
                self._run_control(robot, until_ns)
                robot = self._restarted(until_ns)
        trial = self._watch.result(self._ages.oldest_ns, self._witness.released_ns)
        return trial._replace(limits_kept=self._witness.joints_kept, fell=self._witness.fell)

    def _run_control(self, robot: Robot, until_ns: int) -> None:
        """A life of the control process."""
        computer = self.computer
        start_ns = computer.clocks.monotonic_ns
        control = Lockstep(
            robot.loops,
            computer.control_inputs(robot.loops),
            self._outputs,
            computer,
            computer.sink,
            delays=self._wires.delay,
            start_ns=start_ns,
            suspended=lambda: computer.clocks.suspended_ns,
        )

        def over(now_ns: int) -> bool:
            self._watch.look(now_ns)
            return CONTROL not in computer.running

        for slice_ns in range(start_ns + SLICE_NS, until_ns + SLICE_NS, SLICE_NS):
            control.run(min(slice_ns, until_ns), over)
            if CONTROL not in computer.running:
                return

    def _restarted(self, until_ns: int) -> Robot | None:
        """Let time pass until control is there again; None if it is not to be."""
        computer = self.computer
        while CONTROL not in computer.running and computer.clocks.monotonic_ns < until_ns:
            computer.advance(computer.clocks.monotonic_ns + STEP_NS)
        return assembled(self.config) if CONTROL in computer.running else None

    def flaws(self, until_ns: int) -> list[str]:
        """What the logs and /diagnostics lack, once the walk is over."""
        row, logs = self.row, LiveLogs(self.logs, ())
        lacking = missing_log(logs, self.begin_ns, until_ns, self.config.loops.wbc_period_ns, row.breaks_log)
        found = [flaw.says for flaw in lacking] + moved_unarmed(logs)
        if self._driven_again:
            found.append("drives that had let go were driven again")
        if row.breaks_log and not any(status.gaps for status in self.computer.recorders):
            found.append("the gap in the log is not marked")
        if row.told.encode() not in self._listener.heard:
            found.append(f"/diagnostics did not say: {row.told}")
        written, recorded = self.computer.written, sum(map(_ticks, logs.bags))
        counted = self.computer.dropped + sum(status.failed + status.rejected for status in self.computer.recorders)
        if not 0 <= written - recorded - counted <= row.loses:
            found.append(f"of {written} ticks {recorded} are recorded and {counted} counted as lost")
        return found


def _ticks(log: Log) -> int:
    """How many ticks of all loops a log has."""
    return sum(len(log.read_signal(topic).values) for topic in log.channels if topic.startswith(TICK_TOPIC_PREFIX))


def attempt_on_computer(row: ComputerRow, seed: int, directory: Path) -> tuple[Trial, list[str]]:
    """Walk, break something, and watch.

    Args:
        row: the fault.
        seed: of the phase, and of what the fault leaves to chance.
        directory: for the bags; it is to be empty.

    Returns:
        What came of it, and in what that differs from what it is to be.
    """
    walk = _Walk(row, seed, directory)
    until_ns = walk.end_ns + row.after_ns
    trial = walk.run(until_ns)
    return trial, flaws(row, trial, walk.config) + walk.flaws(until_ns)
