# SPDX-License-Identifier: Apache-2.0
"""One scenario in software-in-the-loop: robot and world on the same wires, in lockstep, logged and measured."""

from __future__ import annotations

import io
import math
import subprocess
import time
from collections.abc import Mapping
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from drivers.bus_health import BusMonitor
from drivers.device_end import Wires
from drivers.dialects import dialect_named
from drivers.memory_bus import MemoryBus
from drivers.memory_ports import MemoryReader, MemoryWriter
from runtime.configuration import dump
from runtime.executors.lockstep import Lockstep
from runtime.executors.loop_run import InputPort, OutputPort, TickSink
from runtime.recording.metrics import path_metrics, push_recovery
from runtime.recording.recorder import RecorderProcess
from runtime.recording.setup import TERRAIN, Attachment, recording_setup
from runtime.robots import load_configuration, topics
from runtime.robots.fresh_frames import FreshFrames
from runtime.robots.robot import Robot
from runtime.robots.uslgo1.assembly import PATH_CAPACITY, assemble
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.tracking.path_csv import read_path_csv
from runtime.tracking.paths import Polyline
from sim_bridge.courses import Push, Scenario, custom
from sim_bridge.courses import scenario as scenario_named
from sim_bridge.observer import Observer, Progress
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.script import ScriptedOperator, ScriptedPath
from sim_bridge.terrain import HeightField

PUSH_DIRECTIONS, PUSH_PHASES = 8, 4
WARM_UP_SCENARIO, WARM_UP_NS = "flat", 1_300_000_000
"""By then the robot walks, and every part of its loops has been used."""


class NullSink:
    """Takes datagrams and keeps none."""

    dropped = 0

    def write(self, datagram: bytes) -> None:
        """Forget it."""


def chosen_scenario(name: str, config: Uslgo1Config, seed: int) -> Scenario:
    """The scenario of a name, or on the path of a CSV file, with the configuration's changes.

    The seed of a push counts through directions, then gait phases.
    """
    if name.lower().endswith(".csv"):
        chosen = custom(read_path_csv(name, capacity=PATH_CAPACITY))
    else:
        chosen = scenario_named(name)
    if config.scenario.speed_mps > 0.0 and chosen.waypoints:
        chosen = chosen.with_speed(config.scenario.speed_mps)
    if chosen.push is not None:
        direction = 2 * np.pi * (seed % PUSH_DIRECTIONS) / PUSH_DIRECTIONS
        phase = (seed // PUSH_DIRECTIONS) % PUSH_PHASES / PUSH_PHASES
        push = Push(direction_rad=direction, impulse_n_s=config.scenario.push_impulse_n_s, gait_phase=phase)
        chosen = chosen.with_push(push)
    return chosen


class Wired(NamedTuple):
    """A robot and its world on the same wires."""

    robot: Robot
    world: QuadrupedWorld
    terrain: HeightField
    bus: MemoryBus
    inputs: dict[str, InputPort]
    outputs: dict[str, OutputPort]


def world_of(config: Uslgo1Config, course: Scenario, terrain: HeightField, wires: Wires, seed: int) -> QuadrupedWorld:
    """The robot at the start of a scenario: standing if it is to walk."""
    height = config.posture.height_m if course.waypoints else config.posture.sitting_height_m
    return QuadrupedWorld(
        config.quadruped,
        config.simulation,
        config.drives.joints(config.safety),
        dialect_named(config.drives.dialect),
        terrain,
        wires,
        seed,
        course.start_pose,
        config.quadruped.standing_angles(height),
        height,
    )


def wire(config: Uslgo1Config, course: Scenario, seed: int) -> Wired:
    """A robot at the start of a scenario, and the far end of all its wires."""
    terrain = course.terrain(seed)
    assembled = assemble(config)
    bus = MemoryBus(config.drives.buses, config.drives.bit_rate_hz)
    world = world_of(config, course, terrain, bus, seed)
    inputs: dict[str, InputPort] = {
        topics.CAN_RECEIVED: MemoryReader(bus),
        topics.BUS_STATUS: BusMonitor(bus.health),
        topics.IMU: world.imu,
        topics.LOCALIZATION: world.localization,
        topics.BATTERY: world.battery,
        topics.TRUTH: world,
        topics.OPERATOR_EVENT: ScriptedOperator(course, config.posture.rise_s),
        topics.PATH: ScriptedPath(course),
    }
    outlet = FreshFrames(MemoryWriter(bus), config.drives.command_age_max_ns)
    return Wired(assembled, world, terrain, bus, inputs, {topics.CAN_SENT: outlet})


@cache
def rehearse(robot: str, estimator: str, controller: str) -> None:
    """Walk a few steps in vain: what is compiled or loaded at first use belongs to the times of no run."""
    config = load_configuration(robot, {"variant.estimator": estimator, "variant.controller": controller})
    wired = wire(config, scenario_named(WARM_UP_SCENARIO), 0)
    executor = Lockstep(wired.robot.loops, wired.inputs, wired.outputs, wired.world, NullSink())
    executor.run(WARM_UP_NS, lambda now_ns: False)


def run_scenario(
    robot: str,
    scenario: str,
    *,
    seed: int = 0,
    estimator: str = "kalman",
    controller: str = "FpMW",
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
        estimator: "kalman" or "truth".
        controller: "FpMW", "FpM" or "pMW".
        overrides: configuration keys and values.
        out: directory of the log and `summary.json`; None records nothing.
        until_s: ends the run after that time at the latest, done or not.
        progress: called with the time reached and the time expected, s.

    Returns:
        The content of `summary.json`.

    Raises:
        UgvError: for an unknown robot, scenario or key, or an output that cannot be written.
    """
    chosen = {**(overrides or {}), "variant.estimator": estimator, "variant.controller": controller}
    config = load_configuration(robot, chosen)
    course = chosen_scenario(scenario, config, seed)
    rehearse(robot, estimator, controller)
    wired = wire(config, course, seed)
    assembled = wired.robot
    written = {record.topic: record for loop in assembled.loops for record in loop.writes}
    observer = Observer(wired.world, written, config, course, until_s, progress)
    with ExitStack() as stack:
        sink: TickSink = NullSink()
        log = ""
        if out is not None:
            setup = recording_setup(
                assembled.loops,
                assembled.name,
                dump(config),
                seed,
                assembled.joint_names,
                revision=git_revision(),
                extra=(Attachment(TERRAIN, "application/octet-stream", packed(wired.terrain)),),
            )
            recorder = stack.enter_context(RecorderProcess(out, setup))
            sink, log = recorder, recorder.path.name
        executor = Lockstep(assembled.loops, wired.inputs, wired.outputs, wired.world, sink)
        began = time.perf_counter()
        reached_ns = executor.run(observer.limit_ns, observer.over)
        wall_s = time.perf_counter() - began
    summary = {
        "robot": robot,
        "scenario": scenario,
        "seed": seed,
        "controller": controller,
        "estimator": estimator,
        **outcome_of(observer, course),
        "sim_time_s": reached_ns * 1e-9,
        "wall_time_s": wall_s,
        "realtime_factor": reached_ns * 1e-9 / wall_s,
        **_timings(executor, config),
        "log": log,
    }
    if out is not None:
        (out / "summary.json").write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2))
    return summary


def outcome_of(observer: Observer, course: Scenario) -> dict[str, Any]:
    """The part of the summary that says how the course was gone through."""
    fault = "" if not observer.fault else str(observer.fault.name)
    return {**_figures(observer, course), "fell": observer.fell, "fault": fault}


def _figures(observer: Observer, course: Scenario) -> dict[str, Any]:
    if not course.waypoints:
        return {"completed": observer.stood_and_sat and not observer.fault}
    path = Polyline(course.waypoints, course.closed)
    t, x, y, yaw = np.array(observer.samples or [(0.0, *course.start_pose)]).T
    metrics = path_metrics(t, np.stack((x, y), axis=1), yaw, path, course.time_limit_s, course.profile)
    outcome = metrics.summary(course.speed_mps)
    if course.push is not None:
        fell = observer.fell or bool(observer.fault)
        push = push_recovery(t, np.stack((x, y), axis=1), path, observer.push_end_s, course.speed_mps, fell)
        outcome["push"] = push.summary()
    return outcome


def _timings(executor: Lockstep, config: Uslgo1Config) -> dict[str, Any]:
    """Wall times of the loops' steps, ms, and how many exceeded the loop's period."""
    figures: dict[str, Any] = {}
    missed: dict[str, int] = {}
    periods = {"wbc": config.loops.wbc_period_ns, "mpc": config.loops.mpc_period_ns}
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
