# SPDX-License-Identifier: Apache-2.0
"""What comes of a replay."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from runtime.recording.continuity import Gap
from runtime.recording.divergence import Divergence, FieldDifference, FieldShift


class Comparing(Enum):
    """What a replay asks: the same bits, the same values within a tolerance, or how far they moved."""

    IDENTITY = "identity"
    TOLERANCE = "tolerance"
    CHANGE = "change"


@dataclass(frozen=True)
class Damage:
    """A recorded value that does not match the checksum recorded with it."""

    loop: str
    step: int
    now_ns: int
    signal: str
    role: str
    difference: FieldDifference | None

    def __str__(self) -> str:
        what = "more than one bit differs"
        if self.difference is not None:
            field, now, then = self.difference.field, self.difference.logged, self.difference.replayed
            what = f"one flipped bit: {field} is {now!r} in the log and was recorded as {then!r}"
        when = f"tick {self.step} of {self.loop} ({self.now_ns / 1e9:.3f} s)"
        return f"{when}: {self.role} {self.signal} was altered after it was recorded; {what}"


@dataclass
class Stretch:
    """Ticks of one loop that were stepped one after the other.

    Attributes:
        loop: name of the loop.
        first, last: index of the first and of the last tick.
        begin_ns, end_ns: when these began.
        ticks: how many; periods that an overrun skipped are none.
        identical: nothing differed.
    """

    loop: str
    first: int
    last: int
    begin_ns: int
    end_ns: int
    ticks: int = 0
    identical: bool = True

    def step(self, index: int, now_ns: int) -> None:
        """Take in one more tick."""
        self.last, self.end_ns = index, now_ns
        self.ticks += 1


@dataclass
class TaskResult:
    """How one task was replayed: steps taken, outputs and states compared, and where it first left the log."""

    task: str
    loop: str
    steps: int = 0
    signals: int = 0
    states: int = 0
    divergence: Divergence | None = None

    @property
    def verdict(self) -> str:
        """In a word, identical; otherwise the first divergence."""
        if self.divergence is not None:
            return str(self.divergence)
        return "identical" if self.steps else "not stepped"


@dataclass
class ReplayResult:
    """What came of a replay.

    Attributes:
        comparing: what was asked.
        tasks: by name, in the order of the loops.
        first: the first divergence of all, in the order of the log.
        damage: recorded values that were altered after they were recorded.
        shifts: how far each field moved (only where changes were asked for, or compared with a tolerance).
        gaps: places where ticks are missing, in the order of the log.
        stretches: what was stepped between them.
        recorded: ticks of the log within the wanted time.
        notes: sentences about the log: cut off, or made elsewhere.
        broken: a sentence for each chunk or attachment that does not match its checksum.
    """

    comparing: Comparing
    tasks: dict[str, TaskResult]
    first: Divergence | None = None
    damage: list[Damage] = field(default_factory=list)
    shifts: list[FieldShift] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    stretches: list[Stretch] = field(default_factory=list)
    recorded: int = 0
    notes: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)

    @property
    def stepped(self) -> int:
        """Ticks that were stepped."""
        return sum(stretch.ticks for stretch in self.stretches)

    @property
    def steps(self) -> int:
        """Steps of tasks taken."""
        return sum(task.steps for task in self.tasks.values())

    @property
    def signals(self) -> int:
        """Values compared, states included."""
        return sum(task.signals + task.states for task in self.tasks.values())

    @property
    def identical(self) -> bool:
        """Whether everything was as recorded, and something was compared at all."""
        return self.first is None and not self.damage and not self.broken and self.signals > 0
