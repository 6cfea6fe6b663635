# SPDX-License-Identifier: Apache-2.0
"""Faults of the loops and of the tasks in them."""

from __future__ import annotations

from collections.abc import Callable

from runtime.records import Record
from sim_bridge.faults.wires import AnyWires, Inject


def late(loop: str, delay_ns: int) -> Inject:
    """Every step of a loop takes so long."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        period_ns = wires.period_ns(loop)
        wires.delays[loop] = lambda index: delay_ns if begin_ns <= index * period_ns < end_ns else 0

    return inject


def idle(task: str) -> Inject:
    """A task does nothing."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        _replace(wires, task, lambda step, now_ns: None if begin_ns <= now_ns < end_ns else step(now_ns))

    return inject


def spoiled(task: str, topic: str, spoil: Callable[[AnyWires, Record], None]) -> Inject:
    """What a task writes on a topic is spoiled."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        (record,) = (record for record in wires.task(task).writes if record.topic == topic)

        def step_and_spoil(step: Callable[[int], None], now_ns: int) -> None:
            step(now_ns)
            if begin_ns <= now_ns < end_ns:
                spoil(wires, record)

        _replace(wires, task, step_and_spoil)

    return inject


def _replace(wires: AnyWires, name: str, instead: Callable[[Callable[[int], None], int], None]) -> None:
    """Have a task's step, and the time, given to something else."""
    task = wires.task(name)
    step = task.step
    task.step = lambda now_ns: instead(step, now_ns)  # type: ignore[method-assign]
