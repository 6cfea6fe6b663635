# SPDX-License-Identifier: Apache-2.0
"""Looks at a robot at every tick, and knows when there is nothing more to see."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from runtime.records import Record
from runtime.robots import topics
from runtime.robots.robot import Robot
from runtime.signals import Fault, SafetyStatus
from sim_bridge.faults.trial import ConfigT_contra, Expectation, Trial
from sim_bridge.faults.wires import FOREVER_NS

LINGER_NS = 100_000_000
"""How long to go on watching when the last answer has been seen."""


class Watch(ABC):
    """What every robot is looked at for; a kind of robot adds the signs of its answers, and its limits.

    Args:
        row: the fault.
        robot: whose signals are looked at.
        begin_ns: when the fault begins.
        others: further records that the row may count.

    Attributes:
        unimpressed: the answer of a robot that goes on.
        final: the answer after which nothing else counts.
        status: of its safety.
        seen: when each answer was first seen, ns.
    """

    unimpressed: ClassVar[str]
    final: ClassVar[str]

    def __init__(
        self,
        row: Expectation[ConfigT_contra],
        robot: Robot,
        begin_ns: int,
        others: Mapping[str, Record] = MappingProxyType({}),
    ) -> None:
        self._answer, self._begin_ns = row.answer, begin_ns
        self._records: dict[str, Record] = {
            r.topic: r for loop in robot.loops for r in (*loop.port_inputs, *loop.writes)
        }
        self._records |= others
        status = self._records[topics.SAFETY]
        assert isinstance(status, SafetyStatus)
        self.status, self.seen = status, dict[str, int]()
        self._counted = None if row.counted is None else (self._records[row.counted[0]], row.counted[1])
        self._before = self._faults = 0
        self._begun = False
        self._stamp_ns, self._end_ns = 0, FOREVER_NS
        self._limits_kept = self._stop_kept = True
        self._fell = False

    @abstractmethod
    def _signs(self) -> Mapping[str, bool]:
        """Which answers the robot is at."""

    @abstractmethod
    def _check(self) -> None:
        """Note limits that are not kept, power where there is to be none, and a fall."""

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
        status = self.status
        if status.stamp_ns == self._stamp_ns:
            return
        self._stamp_ns = status.stamp_ns
        if status.stamp_ns < self._begin_ns:
            if not self._begun:
                self._before = self._count()
            return
        self._faults |= status.warning | status.fault | status.halt
        for answer, there in self._signs().items():
            if there and self.final not in self.seen:
                self.seen.setdefault(answer, self._stamp_ns)
        self._check()
        if self._answer[-1] in self.seen and self._end_ns == FOREVER_NS:
            self._end_ns = now_ns + LINGER_NS

    def over(self, now_ns: int) -> bool:
        """Whether the last answer has been seen, and watched for a while."""
        return now_ns >= self._end_ns

    def result(self, oldest_ns: int, released_ns: int | None = None) -> Trial:
        """What was seen.

        Args:
            oldest_ns: age of the oldest command that reached the far end of its bus.
            released_ns: when the drives let go, be it by themselves, if that was looked at.
        """
        if released_ns is not None:
            self.seen[self.final] = released_ns
            self.seen = {answer: at_ns for answer, at_ns in self.seen.items() if at_ns <= released_ns}
        lasting = [at_ns for answer, at_ns in self.seen.items() if answer != "go on"]
        return Trial(
            tuple(sorted(self.seen, key=self.seen.__getitem__)) or (self.unimpressed,),
            max(lasting, default=self._begin_ns) - self._begin_ns,
            Fault(self._faults),
            self._count() - self._before,
            self._limits_kept,
            oldest_ns,
            self._stop_kept,
            self._fell,
        )
