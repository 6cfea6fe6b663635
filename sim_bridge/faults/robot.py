# SPDX-License-Identifier: Apache-2.0
"""Faults of the loops and of the robot as a whole."""

from __future__ import annotations

import numpy as np

from runtime.signals import JointCommand
from sim_bridge.faults.wires import Inject, Wires


def late(loop: str, delay_ns: int) -> Inject:
    """Every step of a loop takes so long."""

    def inject(wires: Wires, begin_ns: int, end_ns: int) -> None:
        loops = wires.config.loops
        period_ns = loops.wbc_period_ns if loop == "wbc" else loops.mpc_period_ns
        wires.delays[loop] = lambda index: delay_ns if begin_ns <= index * period_ns < end_ns else 0

    return inject


def rolled_over(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """Somebody lifts the robot on one side until it lies on the other."""
    wires.world.roll(begin_ns, 600_000_000, float(wires.rng.choice((-1.0, 1.0))) * 50.0)


def pushed_over(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """Somebody throws the robot over, so that its legs fold."""
    wires.world.push(begin_ns, 150_000_000, float(wires.rng.choice((-0.5, 0.5))) * np.pi, 260.0)


def bad_command(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """The control law computes a torque that is no number."""
    task, joint = wires.tasks["locomotion"], int(wires.rng.integers(12))
    step = task.step

    def poisoned(now_ns: int) -> None:
        step(now_ns)
        if begin_ns <= now_ns < end_ns:
            (command,) = (record for record in task.writes if isinstance(record, JointCommand))
            command.effort[joint] = np.nan

    task.step = poisoned  # type: ignore[method-assign]
