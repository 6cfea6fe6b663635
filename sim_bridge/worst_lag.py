# SPDX-License-Identifier: Apache-2.0
"""How late a world in real time was at worst, and when: its steps are many, its ticks in the log few."""

from __future__ import annotations

from typing import NamedTuple


class Lag(NamedTuple):
    """One step of a world.

    Attributes:
        due_ns: when it should have begun.
        began_ns: when it began.
        done_ns: when it was done.
    """

    due_ns: int
    began_ns: int
    done_ns: int


class WorstLag:
    """Keeps the step that was done latest after it was due; while a world stands still it is late, too."""

    def __init__(self) -> None:
        self._lost_ns = 0
        self._worst: Lag | None = None

    def note(self, step: Lag, lost_ns: int) -> None:
        """Take note of a step.

        Args:
            step: due as the world now counts.
            lost_ns: for how long the world had stood still before it, since its start.
        """
        step = step._replace(due_ns=step.due_ns - (lost_ns - self._lost_ns))
        if self._worst is None or step.done_ns - step.due_ns > self._worst.done_ns - self._worst.due_ns:
            self._worst = step

    def take(self, lost_ns: int) -> Lag:
        """The worst step since the last time; there was one."""
        assert self._worst is not None
        worst, self._worst, self._lost_ns = self._worst, None, lost_ns
        return worst
