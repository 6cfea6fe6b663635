# SPDX-License-Identifier: Apache-2.0
"""One fault, tried: a robot under way, something that breaks, and what the robot does about it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from runtime.configuration import dump
from runtime.executors.lockstep import Lockstep
from runtime.recording.bag import BagSink
from runtime.recording.setup import recording_setup
from runtime.robots import topics
from sim_bridge.faults.command_ages import CommandAges
from sim_bridge.faults.row import Row
from sim_bridge.faults.trial import Trial
from sim_bridge.faults.wires import FOREVER_NS, AnyWires, Wires
from sim_bridge.run import NullSink, wire
from sim_bridge.simulation import simulation_of


def attempt(row: Row[Any, Any], seed: int, out: Path | None = None) -> Trial:
    """Set out, break something at a time that the seed chooses, and watch.

    Args:
        row: the fault.
        seed: of the time, and of what the fault leaves to chance.
        out: directory of a log; None records nothing.
    """
    config = row.config
    rng = np.random.default_rng((seed, *row.name.encode()))
    earliest_ns, latest_ns = row.strikes_ns(config)
    begin_ns = earliest_ns + int(rng.integers(latest_ns - earliest_ns))
    end_ns = min(begin_ns + row.lasts_ns, FOREVER_NS)
    wired = wire(config, simulation_of(config).scenario(row.course, seed), seed)
    robot = wired.robot
    wires: AnyWires = Wires(config, wired.bus, wired.world, wired.inputs, robot.loops, rng)
    if row.mended is not None:
        row.mended(wires, end_ns)
    row.inject(wires, begin_ns, end_ns)
    recorder = None
    if out is not None:
        recorder = _Recorder(out, recording_setup(robot.loops, robot.name, dump(config), seed, robot.joint_names))
    ages = CommandAges(wired.bus)
    watch = row.watch(config, robot, wired.world, begin_ns)
    executor = Lockstep(
        robot.loops,
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
