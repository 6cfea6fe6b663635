# SPDX-License-Identifier: Apache-2.0
"""What is done to a robot as a whole."""

from __future__ import annotations

import numpy as np

from sim_bridge.faults.wires import AnyWires, Inject


def rolled_over(moment_nm: float) -> Inject:
    """Somebody lifts the robot on one side until it lies on the other."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        wires.world.roll(begin_ns, 600_000_000, float(wires.rng.choice((-1.0, 1.0))) * moment_nm)

    return inject


def pushed_over(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """Somebody throws the robot over, so that its legs fold."""
    wires.world.push(begin_ns, 150_000_000, float(wires.rng.choice((-0.5, 0.5))) * np.pi, 260.0)
