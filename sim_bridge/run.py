# SPDX-License-Identifier: Apache-2.0
"""One scenario in software-in-the-loop: robot and world on the same wires, in lockstep, logged and measured."""

from __future__ import annotations

import io
import math
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from drivers.bus_health import BusMonitor
from drivers.memory_bus import MemoryBus
from drivers.memory_ports import MemoryReader, MemoryWriter
from runtime.configuration import dump
from runtime.executors.lockstep import Lockstep
from runtime.executors.loop_run import InputPort, OutputPort, TickSink
from runtime.recording.recorder import RecorderProcess
from runtime.recording.setup import TERRAIN, Attachment, recording_setup
from runtime.robots import assembled, load_configuration, topics
from runtime.robots.fresh_frames import FreshFrames
from runtime.robots.robot import Robot
from runtime.robots.robot_config import RobotConfig
from runtime.tasks import Loop
from sim_bridge.observer import Observer, Progress
from sim_bridge.outcome import outcome_of
from sim_bridge.scenario import Scenario
from sim_bridge.script import ScriptedPath
from sim_bridge.simulation import simulation_of
from sim_bridge.terrain import HeightField
from sim_bridge.world import World


class NullSink:
    """Takes datagrams and keeps none."""

    dropped = 0

    def write(self, datagram: bytes) -> None:
        """Forget it."""


class Wired(NamedTuple):
    """A robot and its world on the same wires."""

    robot: Robot
    world: World
    terrain: HeightField
    bus: MemoryBus
    inputs: dict[str, InputPort]
    outputs: dict[str, OutputPort]


def wire(config: RobotConfig, course: Scenario, seed: int) -> Wired:
    """A robot at the start of a scenario, and the far end of all its wires."""
    terrain, simulation = course.terrain(seed), simulation_of(config)
    bus = MemoryBus(config.drives.buses, config.drives.bit_rate_hz)
    world = simulation.world(course, terrain, bus, seed)
    inputs: dict[str, InputPort] = {
        topics.CAN_RECEIVED: MemoryReader(bus),
        topics.BUS_STATUS: BusMonitor(bus.health),
        **simulation.sensors(world),
        topics.TRUTH: world,
        topics.OPERATOR_EVENT: simulation.operator(course, world),
        topics.PATH: ScriptedPath(course),
    }
    outlet = FreshFrames(MemoryWriter(bus), config.drives.command_age_max_ns)
    return Wired(assembled(config), world, terrain, bus, inputs, {topics.CAN_SENT: outlet})


@cache
def rehearse(robot: str, estimator: str, controller: str) -> None:
    """Move a little in vain: what is compiled or loaded at first use belongs to the times of no run."""
    config = load_configuration(robot, {"variant.estimator": estimator, "variant.controller": controller})
    simulation = simulation_of(config)
    wired = wire(config, simulation.scenario(simulation.warm_up, 0), 0)
    executor = Lockstep(wired.robot.loops, wired.inputs, wired.outputs, wired.world, NullSink())
    executor.run(simulation.warm_up_ns, lambda now_ns: False)


def run_scenario(
    robot: str,
    scenario: str,
    *,
    seed: int = 0,
    estimator: str | None = None,
    controller: str | None = None,
    overrides: Mapping[str, str] | None = None,
    out: Path | None = None,
    until_s: float = math.inf,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Run a scenario.

    Args:
        robot: its name.
        scenario: its name, or a CSV file with a path.
        seed: of terrain, noise and push.
        estimator: "kalman" or "truth"; None for the robot's own.
        controller: one that the robot has; None for its own.
        overrides: configuration keys and values.
        out: directory of the log and `summary.json`; None records nothing.
        until_s: ends the run after that time at the latest, done or not.
        progress: called with the time reached and the time expected, s.

    Returns:
        The content of `summary.json`.

    Raises:
        UgvError: for an unknown robot, scenario or key, or an output that cannot be written.
    """
    config = load_configuration(robot, with_variant(overrides, estimator, controller))
    simulation = simulation_of(config)
    course = simulation.scenario(scenario, seed)
    rehearse(robot, config.variant.estimator, config.variant.controller)
    wired = wire(config, course, seed)
    loops = wired.robot.loops
    written = {record.topic: record for loop in loops for record in loop.writes}
    observer = Observer(wired.world, written, simulation, course, until_s, progress)
    with ExitStack() as stack:
        sink: TickSink = NullSink()
        log = ""
        if out is not None:
            setup = recording_setup(
                loops,
                wired.robot.name,
                dump(config),
                seed,
                wired.robot.joint_names,
                revision=git_revision(),
                extra=(Attachment(TERRAIN, "application/octet-stream", packed(wired.terrain)),),
            )
            recorder = stack.enter_context(RecorderProcess(out, setup))
            sink, log = recorder, recorder.path.name
        executor = Lockstep(loops, wired.inputs, wired.outputs, wired.world, sink)
        began = time.perf_counter()
        reached_ns = executor.run(observer.limit_ns, observer.over)
        wall_s = time.perf_counter() - began
    summary = {
        "robot": robot,
        "scenario": scenario,
        "seed": seed,
        "controller": config.variant.controller,
        "estimator": config.variant.estimator,
        **outcome_of(observer, course),
        "sim_time_s": reached_ns * 1e-9,
        "wall_time_s": wall_s,
        "realtime_factor": reached_ns * 1e-9 / wall_s,
        **_timings(executor, loops),
        "log": log,
    }
    if out is not None:
        (out / "summary.json").write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2))
    return summary


def with_variant(overrides: Mapping[str, str] | None, estimator: str | None, controller: str | None) -> dict[str, str]:
    """Overrides, with those of the algorithms that were chosen by name."""
    named = {"variant.estimator": estimator, "variant.controller": controller}
    return {**(overrides or {}), **{key: name for key, name in named.items() if name is not None}}


def _timings(executor: Lockstep, loops: Sequence[Loop]) -> dict[str, Any]:
    """Wall times of the loops' steps, ms, and how many exceeded the loop's period."""
    figures: dict[str, Any] = {}
    missed: dict[str, int] = {}
    periods = {loop.name: loop.period_ns for loop in loops}
    for name, values in executor.compute_ns.items():
        taken = np.array(values, dtype=np.float64)
        median, p99 = np.percentile(taken, (50, 99)) * 1e-6
        figures[f"{name}_ms"] = {"median": float(median), "p99": float(p99), "max": float(taken.max() * 1e-6)}
        missed[name] = int((taken > periods[name]).sum())
    return {**figures, "missed_deadlines": missed}


def packed(terrain: HeightField) -> bytes:
    """The ground as it is attached to the log."""
    buffer = io.BytesIO()
    arrays: dict[str, npt.ArrayLike] = {
        "x0": terrain.x_origin_m,
        "y0": terrain.y_origin_m,
        "spacing": terrain.spacing_m,
        "heights": terrain.heights_m,
    }
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def git_revision() -> str | None:
    """The revision of the code, if it lies in a git checkout."""
    here = Path(__file__).resolve().parent
    try:
        done = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--dirty"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
