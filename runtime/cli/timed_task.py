# SPDX-License-Identifier: Apache-2.0
"""A task with a stop watch, to measure tasks where a replay steps them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from time import perf_counter_ns

from runtime.tasks import Loop, Scheduled, Task


class TimedTask(Task):
    """Steps another task and keeps how long that took.

    Attributes:
        steps: time of the loop (ns) and wall time (ns) of each step.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self.name, self.reads, self.writes, self.state = task.name, task.reads, task.writes, task.state
        self.steps: list[tuple[int, int]] = []

    def step(self, now_ns: int) -> None:
        """One step of the other task."""
        began = perf_counter_ns()
        self._task.step(now_ns)
        self.steps.append((now_ns, perf_counter_ns() - began))

    def save(self) -> bytes:
        """The other task's state."""
        return self._task.save()

    def restore(self, data: bytes | memoryview) -> None:
        """Take up a state of the other task."""
        self._task.restore(data)


def timed(loops: Sequence[Loop]) -> tuple[tuple[Loop, ...], dict[str, TimedTask]]:
    """The same loops with a stop watch on every task, and those tasks by name."""
    tasks = {item.task.name: TimedTask(item.task) for loop in loops for item in loop.schedule}
    return (
        tuple(
            dataclasses.replace(loop, schedule=tuple(Scheduled(tasks[i.task.name], i.every) for i in loop.schedule))
            for loop in loops
        ),
        tasks,
    )
