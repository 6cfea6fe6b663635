# SPDX-License-Identifier: Apache-2.0
"""The simulator as a process of its own, for runs against the wall clock.

It is given a `Task` as JSON on standard input, and answers on standard output with one JSON object a line: `ready` when
the buses are there, `progress` now and then, and `over` when the run is. The robot keeps its wires and its ground until
SIGTERM, so that control can be ended first; then comes the `outcome`.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from drivers.device_end import DeviceEnd, open_device_end
from runtime.executors.companions import SIM, CompanionTicks
from runtime.executors.linux import lock_memory, run_first
from runtime.executors.loop_run import InputPort
from runtime.executors.tick_stream import OBSERVER_SOCKET, RECORDER_SOCKET, TickListener, TickStream
from runtime.link.loop import link_loop
from runtime.records import Record
from runtime.robots import assembled, load_configuration
from runtime.robots.robot_config import RobotConfig
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Mode
from sim_bridge.endurance import WATCHED, EnduranceObserver, EnduringOperator, EnduringPath
from sim_bridge.faults.injector import Injector, Tap
from sim_bridge.faults.live_buses import LiveBuses
from sim_bridge.faults.live_table import LIVE_ROWS
from sim_bridge.live_world import LiveWorld
from sim_bridge.observer import SAMPLE_NS, Observer
from sim_bridge.outcome import outcome_of
from sim_bridge.outlets import sources_of
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.ros_outlet import RosOutlet
from sim_bridge.run import rehearse
from sim_bridge.scenario import Scenario
from sim_bridge.script import ScriptedPath
from sim_bridge.simulation import Simulation, simulation_of
from sim_bridge.tick_mirror import TickMirror
from sim_bridge.virtual_links import remove_orphaned_links
from sim_bridge.world import World


class Task(msgspec.Struct):
    """What to simulate.

    Attributes:
        config: file of the resolved configuration.
        scenario, seed: of the run.
        directory: runtime directory, shared with the other processes.
        until_s: ends the run by then, world time.
        duration_s: walk lap after lap for so long instead of once.
        injects: orders of faults follow on standard input; the buses are then hubs.
        operator_at: endpoint of zenoh at which the operator's messages leave, if by a way of their own.
    """

    config: str
    scenario: str
    seed: int
    directory: str
    until_s: float | None = None
    duration_s: float | None = None
    injects: bool = False
    operator_at: str = ""


def _answer(**entries: object) -> None:
    with suppress(BrokenPipeError):  # nobody hears it any more: SIGTERM is on its way
        os.write(sys.stdout.fileno(), json.dumps(entries).encode() + b"\n")


class Part(NamedTuple):
    """What the operator does in a run, and who watches it."""

    operator: InputPort
    path: InputPort
    over: Callable[[int], bool]
    outcome: Callable[[], dict[str, Any]]


def _part(task: Task, simulation: Simulation, course: Scenario, world: World, records: Mapping[str, Record]) -> Part:
    if task.duration_s is not None:
        operator = EnduringOperator(course, records, simulation.ready(records))
        watcher = EnduranceObserver(simulation, world, operator, records, task.duration_s, _report_mode)
        return Part(operator, EnduringPath(operator), watcher.over, watcher.outcome)
    until_s = math.inf if task.until_s is None else task.until_s
    observer = Observer(world, records, simulation, course, until_s, _report)
    return Part(
        simulation.operator(course, world), ScriptedPath(course), observer.over, lambda: outcome_of(observer, course)
    )


def _report(done_s: float, expected_s: float) -> None:
    _answer(progress=(done_s, expected_s))


def _report_mode(done_s: float, expected_s: float, mode: Mode) -> None:
    _answer(progress=(done_s, expected_s), mode=mode.name)


def _device_end(task: Task, config: RobotConfig) -> DeviceEnd:
    drives = config.drives
    return LiveBuses(drives.channels) if task.injects else open_device_end(drives.interface, drives.channels)


def simulate(task: Task) -> dict[str, Any]:
    """Run a scenario until it is over, and on until SIGTERM; returns what came of it."""
    config = load_configuration(task.config)
    course = simulation_of(config).scenario(task.scenario, task.seed)
    rehearse(config.robot, config.variant.estimator, config.variant.controller)
    return _live(task, config, course, Path(task.directory))


def _live(task: Task, config: RobotConfig, course: Scenario, directory: Path) -> dict[str, Any]:
    simulation = simulation_of(config)
    loops, link = assembled(config).loops, link_loop(config.link, config.realtime.link_priority)
    stop: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    refused = [sentence for sentence in (run_first(SIM.priority), lock_memory()) if sentence]
    with ExitStack() as stack:
        wires = stack.enter_context(closing(_device_end(task, config)))
        listener = stack.enter_context(closing(TickListener(directory / OBSERVER_SOCKET)))
        ros = stack.enter_context(RosOutlet(config.link))
        operator_ros = ros
        if task.operator_at:
            way = msgspec.structs.replace(config.link, listen=(task.operator_at,))
            operator_ros = stack.enter_context(RosOutlet(way, "ugv_operator"))
        stack.callback(remove_orphaned_links)
        world = simulation.world(course, course.terrain(task.seed), wires, task.seed)
        mirror = TickMirror(loops, (*WATCHED, *simulation.watched), listener)
        part = _part(task, simulation, course, world, mirror.records)
        sources = sources_of(simulation, world, part.operator, part.path, loops, ros, operator_ros, directory)
        inputs = {record.topic: port for record, port, _ in sources}
        injector = None
        if isinstance(wires, LiveBuses):
            assert isinstance(config, Uslgo1Config)
            assert isinstance(world, QuadrupedWorld)
            faults = {row.name: row.inject for row in LIVE_ROWS if row.inject is not None}
            injector = Injector(config, world, wires, inputs, mirror, faults, directory, _answer, sys.stdin.fileno())
            sources = [(record, Tap(inputs, record.topic), outlet) for record, _, outlet in sources]
        live = LiveWorld(
            world,
            wires,
            simulation.step_ns,
            sources,
            partial(CompanionTicks, (*loops, link), SIM, TickStream(directory / RECORDER_SOCKET)),
            operator_ros.heard,
        )

        times: dict[str, float] = {}

        def ended(now_ns: int) -> bool:
            if injector is not None:
                injector.step(now_ns)
            if now_ns % SAMPLE_NS:
                return False
            mirror.update()
            if not times and part.over(now_ns):
                times.update(_times(live, now_ns))
                _answer(over=True)
            return bool(stop)

        _answer(ready=True, refused=refused)
        reached_ns = live.run(ended)
        times = times or _times(live, reached_ns)
    return {**part.outcome(), **times}


def _times(live: LiveWorld, reached_ns: int) -> dict[str, float]:
    wall_s = (time.monotonic_ns() - live.start_ns + live.lost_ns) * 1e-9
    return {
        "sim_time_s": reached_ns * 1e-9,
        "wall_time_s": wall_s,
        "lost_time_s": live.lost_ns * 1e-9,
        "realtime_factor": reached_ns * 1e-9 / wall_s,
    }


def main() -> int:
    """Run the simulator; returns its exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    task = msgspec.json.decode(sys.stdin.buffer.readline(), type=Task)
    _answer(outcome=msgspec.to_builtins(simulate(task)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
