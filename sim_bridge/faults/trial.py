# SPDX-License-Identifier: Apache-2.0
"""One fault in one walk: what the robot did about it, how soon, and whether its joints stayed within their limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from runtime.configuration import dump
from runtime.executors.lockstep import Lockstep
from runtime.recording.bag import BagSink
from runtime.recording.setup import recording_setup
from runtime.records import Record
from runtime.robots import load_configuration, topics
from runtime.robots.robot import Robot
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Fault, Gait, JointCommand, Mode, SafetyStatus
from sim_bridge.courses import scenario
from sim_bridge.faults.command_ages import CommandAges
from sim_bridge.faults.joint_limits import JointLimits
from sim_bridge.faults.wires import FOREVER_NS, Inject, Wires
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.run import NullSink, wire

WALKING_NS = 1_600_000_000
"""By then the robot trots at nearly its full speed."""
LINGER_NS = 100_000_000
"""How long to go on watching when the last answer has been seen."""


@dataclass(frozen=True)
class Row:
    """A fault and its answer.

    Attributes:
        name: for people.
        inject: prepares it.
        answer: what the robot is to do, in order: walk on, derate, stand, go on, crouch, damp.
        bound_ns: how soon the last of it (but going on) is to be reached, of the configuration.
        lasts_ns: how long the fault is there.
        fault: bits by which it is to be named.
        counted: topic and field of what is to be counted.
        mended: called with the wires and the time at which the fault ends.
        forced: whether a force from outside may take the joints beyond their limits.
        settings: configuration that shows this answer.
    """

    name: str
    inject: Inject
    answer: tuple[str, ...]
    bound_ns: Callable[[Uslgo1Config], int]
    lasts_ns: int = FOREVER_NS
    fault: Fault = Fault.NONE
    counted: tuple[str, str] | None = None
    mended: Callable[[Wires, int], None] | None = None
    forced: bool = False
    settings: dict[str, str] = field(default_factory=dict)


class Expectation(Protocol):
    """What is to come of a fault; see `Row`."""

    @property
    def answer(self) -> tuple[str, ...]:
        """What the robot is to do, in order."""

    @property
    def bound_ns(self) -> Callable[[Uslgo1Config], int]:
        """How soon the last of it is to be reached."""

    @property
    def fault(self) -> Fault:
        """Bits by which it is to be named."""

    @property
    def counted(self) -> tuple[str, str] | None:
        """Topic and field of what is to be counted."""

    @property
    def forced(self) -> bool:
        """Whether a force from outside may take the joints beyond their limits."""


class Trial(NamedTuple):
    """What came of one.

    Attributes:
        answer: what the robot did, in order.
        time_ns: from the fault to the last of it, but going on; 0 if it walked on.
        faults: bits that were seen.
        counted: by how much the count grew.
        joints_kept: whether every joint stayed within its limits (`JointLimits`) until the robot was damped.
        oldest_ns: age of the oldest command when it reached a drive.
        damping_kept: whether no stiffness nor torque was commanded to a damped robot.
        fell: whether it fell before it was damped.
    """

    answer: tuple[str, ...]
    time_ns: int
    faults: Fault
    counted: int
    joints_kept: bool
    oldest_ns: int
    damping_kept: bool
    fell: bool


def flaws(row: Expectation, trial: Trial, config: Uslgo1Config) -> list[str]:
    """In what a trial differs from what it is to be."""
    found = []
    if trial.answer != row.answer:
        found.append(f"answer is {', '.join(trial.answer)}")
    if trial.time_ns > row.bound_ns(config):
        found.append(f"took {trial.time_ns * 1e-6:.0f} ms of {row.bound_ns(config) * 1e-6:.0f} ms")
    if row.fault & ~trial.faults:
        found.append(f"{(row.fault & ~trial.faults).name} was not named")
    if row.counted is not None and not trial.counted:
        found.append(f"{row.counted[1]} did not grow")
    if not trial.joints_kept and not row.forced:
        found.append("a joint passed its limits")
    if trial.oldest_ns > config.drives.command_age_max_ns:
        found.append(f"a command of {trial.oldest_ns * 1e-6:.1f} ms was sent")
    if not trial.damping_kept:
        found.append("a damped joint was driven")
    if trial.fell:
        found.append("it fell before it was damped")
    return found


def attempt(row: Row, seed: int, out: Path | None = None) -> Trial:
    """Walk, break something at a phase of the gait that the seed chooses, and watch.

    Args:
        row: the fault.
        seed: of the phase, and of what the fault leaves to chance.
        out: directory of a log; None records nothing.
    """
    config = load_configuration("uslgo1", row.settings)
    assert isinstance(config, Uslgo1Config)
    rng = np.random.default_rng((seed, *row.name.encode()))
    begin_ns = WALKING_NS + int(rng.integers(config.gait.period_ns))
    end_ns = min(begin_ns + row.lasts_ns, FOREVER_NS)
    wired = wire(config, scenario("flat"), seed)
    assert isinstance(wired.world, QuadrupedWorld)
    tasks = {item.task.name: item.task for loop in wired.robot.loops for item in loop.schedule}
    wires = Wires(config, wired.bus, wired.world, wired.inputs, tasks, rng)
    if row.mended is not None:
        row.mended(wires, end_ns)
    row.inject(wires, begin_ns, end_ns)
    robot, recorder = wired.robot, None
    if out is not None:
        recorder = _Recorder(out, recording_setup(robot.loops, robot.name, dump(config), seed, robot.joint_names))
    ages = CommandAges(wired.bus)
    watch = Watch(row, config, wired.robot, wired.world, begin_ns)
    executor = Lockstep(
        wired.robot.loops,
        wired.inputs,
        {topics.CAN_SENT: ages.noted(wired.outputs[topics.CAN_SENT])},
        wired.world,
        recorder or NullSink(),
        delays=wires.delay,
    )
    limit_ns = begin_ns + row.bound_ns(config) + min(row.lasts_ns, 4_000_000_000) + 1_500_000_000

    def over(now_ns: int) -> bool:
        for event in wires.events:
            event(now_ns)
        watch.look(now_ns)
        return watch.over(now_ns)

    executor.run(limit_ns, over)
    if recorder is not None:
        recorder.close()
    return watch.result(ages.oldest_ns)


class _Recorder(BagSink):
    """Records in this process and drops nothing."""

    dropped = 0


class Watch:
    """Looks at every tick, and knows when there is nothing more to see.

    Args:
        row: the fault.
        config: of the robot.
        robot: whose signals are looked at;
        world: and its true state.
        begin_ns: when the fault begins.
        others: further records that the row may count.
    """

    def __init__(
        self,
        row: Expectation,
        config: Uslgo1Config,
        robot: Robot,
        world: QuadrupedWorld,
        begin_ns: int,
        others: Mapping[str, Record] = MappingProxyType({}),
    ) -> None:
        self._row, self._config, self._world = row, config, world
        self._begin_ns = begin_ns
        records: dict[str, Record] = {r.topic: r for loop in robot.loops for r in (*loop.port_inputs, *loop.writes)}
        records |= others
        self._status: SafetyStatus = records[topics.SAFETY]  # type: ignore[assignment]
        self._gait: Gait = records[topics.GAIT]  # type: ignore[assignment]
        self._command: JointCommand = records[topics.JOINT_COMMAND_SAFE]  # type: ignore[assignment]
        self._counted = None if row.counted is None else (records[row.counted[0]], row.counted[1])
        self._limits = JointLimits(config.safety)
        self._seen: dict[str, int] = {}
        self._before = self._faults = 0
        self._begun = False
        self._joints_kept = self._damping_kept = True
        self._fell = False
        self._stamp_ns, self._end_ns = 0, FOREVER_NS

    def _count(self) -> int:
        if self._counted is None:
            return 0
        record, name = self._counted
        return int(np.sum(getattr(record, name)))

    def begin(self) -> None:
        """The fault is about to begin: what is counted from now on comes of it, even before the next tick."""
        self._before, self._begun = self._count(), True

    def look(self, now_ns: int) -> None:
        """One tick."""
        status = self._status
        if status.stamp_ns == self._stamp_ns:
            return
        self._stamp_ns = status.stamp_ns
        if status.stamp_ns < self._begin_ns:
            if not self._begun:
                self._before = self._count()
            return
        self._faults |= status.warning | status.fault | status.halt
        self._note(status.stamp_ns)
        self._check_joints()
        if self._row.answer[-1] in self._seen and self._end_ns == FOREVER_NS:
            self._end_ns = now_ns + LINGER_NS

    def over(self, now_ns: int) -> bool:
        """Whether the last answer has been seen, and watched for a while."""
        return now_ns >= self._end_ns

    def _note(self, at_ns: int) -> None:
        """Which answer the robot is at, if it is new."""
        status, walking = self._status, bool(self._gait.walking)
        powered = status.mode in (Mode.STANDING, Mode.ACTIVE)
        signs = {
            "derate": status.derated,
            "stand": powered and not walking,
            "go on": powered and walking and "stand" in self._seen,
            "crouch": status.mode == Mode.CROUCHING,
            "damp": status.mode == Mode.DAMPED,
        }
        for answer, there in signs.items():
            if there and "damp" not in self._seen:
                self._seen.setdefault(answer, at_ns)

    def _check_joints(self) -> None:
        world, command = self._world, self._command
        if "damp" in self._seen:
            idle = not command.stiffness.any() and not command.effort.any() and not command.velocity.any()
            self._damping_kept = self._damping_kept and idle
            return
        bound = self._config.safety.derated_effort_nm if self._status.derated else self._config.safety.effort_max_nm
        kept = self._limits.kept(world) and bool((np.abs(command.effort) <= bound).all())
        self._joints_kept = self._joints_kept and kept
        self._fell = self._fell or world.tilt > self._config.safety.tilt_max_rad + 0.1

    def result(self, oldest_ns: int, released_ns: int | None = None) -> Trial:
        """What was seen.

        Args:
            oldest_ns: age of the oldest command that reached a drive.
            released_ns: when the drives let go, be it by themselves, if that was looked at.
        """
        if released_ns is not None:
            self._seen["damp"] = released_ns
            self._seen = {answer: at_ns for answer, at_ns in self._seen.items() if at_ns <= self._seen["damp"]}
        lasting = [at_ns for answer, at_ns in self._seen.items() if answer != "go on"]
        return Trial(
            tuple(sorted(self._seen, key=self._seen.__getitem__)) or ("walk on",),
            max(lasting, default=self._begin_ns) - self._begin_ns,
            Fault(self._faults),
            self._count() - self._before,
            self._joints_kept,
            oldest_ns,
            self._damping_kept,
            self._fell,
        )
