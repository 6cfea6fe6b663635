# SPDX-License-Identifier: Apache-2.0
"""Tasks, and the loops that step them.

A task computes outputs from inputs and its own state and does nothing else: no I/O, no clock, no unseeded random
number, no module state. All that must survive from one step to the next is in records, so that any step can be taken
again, in another process, from the log.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from runtime.records import Record


class Task(ABC):
    """One computation of a loop.

    Attributes:
        name: unique within the robot; names the task's state in the log.
        reads: records that the task only reads.
        writes: records that the task writes and nobody else does.
        state: the record that holds everything that must survive a step, or None.
    """

    name: str
    reads: Sequence[Record] = ()
    writes: Sequence[Record] = ()
    state: Record | None = None

    @abstractmethod
    def step(self, now_ns: int) -> None:
        """Compute the outputs of the instant `now_ns`, the release of the loop."""

    def save(self) -> bytes:
        """The state as bytes."""
        return b"" if self.state is None else self.state.to_bytes()

    def restore(self, data: bytes | memoryview) -> None:
        """Take up a saved state; the next step is then the one that would have followed."""
        if self.state is not None:
            self.state.load(data)


@dataclass(frozen=True)
class Scheduled:
    """A task within a loop, stepped at every n-th release."""

    task: Task
    every: int = 1


@dataclass(frozen=True)
class Loop:
    """A fixed-rate loop: read ports, receive, step tasks in order, write ports.

    Attributes:
        name: unique within the robot.
        period_ns: time between releases.
        budget_ns: age at which results leave the loop; later results leave when they are ready.
        priority: of the thread in real time.
        port_inputs: records filled by ports (a bus, a sensor) before the tasks run.
        receives: records that another loop writes; copies, refreshed at each release.
        schedule: the tasks.
        port_outputs: records handed to ports after the tasks ran.
        last_outputs: records handed to the ports of the same topics when the loop ends in real time, whatever ended it;
            no task writes them.
    """

    name: str
    period_ns: int
    budget_ns: int
    priority: int
    port_inputs: tuple[Record, ...]
    receives: tuple[Record, ...]
    schedule: tuple[Scheduled, ...]
    port_outputs: tuple[Record, ...]
    last_outputs: tuple[Record, ...] = ()

    @property
    def writes(self) -> tuple[Record, ...]:
        """Every record that a task of this loop writes."""
        return tuple(record for item in self.schedule for record in item.task.writes)


def due(item: Scheduled, index: int) -> bool:
    """Whether a scheduled task steps at the tick `index`."""
    return index % item.every == 0
