# SPDX-License-Identifier: Apache-2.0
"""The simulator as a process of its own, for runs against the wall clock.

It is given a `Task` as JSON on standard input, and answers on standard output with one JSON object a line: `ready` when
the buses are there, `progress` now and then, and `outcome` at the end of the run.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from drivers.device_end import open_device_end
from runtime.executors.companions import SIM, CompanionTicks
from runtime.executors.control import OBSERVER
from runtime.executors.linux import lock_memory, run_first
from runtime.executors.runtime_directory import remove_if_orphaned
from runtime.executors.tick_stream import TickListener, TickStream
from runtime.recording.service import SOCKET
from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.courses import Scenario
from sim_bridge.live_world import LiveWorld
from sim_bridge.observer import Observer
from sim_bridge.outlets import sources_of
from sim_bridge.ros_outlet import RosOutlet
from sim_bridge.run import chosen_scenario, outcome_of, rehearse, world_of
from sim_bridge.tick_mirror import TickMirror

WATCHED = (topics.SAFETY, topics.GAIT, topics.BODY_COMMAND)


class Task(msgspec.Struct):
    """What to simulate.

    Attributes:
        config: file of the resolved configuration.
        scenario, seed: of the run.
        directory: runtime directory, shared with the other processes.
        until_s: ends the run by then, world time.
    """

    config: str
    scenario: str
    seed: int
    directory: str
    until_s: float | None = None


def _answer(**entries: object) -> None:
    sys.stdout.write(json.dumps(entries) + "\n")
    sys.stdout.flush()


def _report(done_s: float, expected_s: float) -> None:
    _answer(progress=(done_s, expected_s))


def simulate(task: Task) -> dict[str, Any]:
    """Run a scenario and say what came of it."""
    config = load_configuration(task.config)
    course = chosen_scenario(task.scenario, config, task.seed)
    rehearse(config.robot, config.variant.estimator, config.variant.controller)
    return _live(task, config, course, Path(task.directory))


def _live(task: Task, config: Uslgo1Config, course: Scenario, directory: Path) -> dict[str, Any]:
    loops = assemble(config).loops
    stop: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    refused = [sentence for sentence in (run_first(SIM.priority), lock_memory()) if sentence]
    with ExitStack() as stack:
        wires = stack.enter_context(closing(open_device_end(config.drives.interface, config.drives.channels)))
        listener = stack.enter_context(closing(TickListener(directory / OBSERVER)))
        ros = stack.enter_context(RosOutlet(config.link))
        stack.callback(remove_if_orphaned, directory)
        world = world_of(config, course, course.terrain(task.seed), wires, task.seed)
        mirror = TickMirror(loops, WATCHED, listener)
        until_s = math.inf if task.until_s is None else task.until_s
        observer = Observer(world, mirror.records, config, course, until_s, _report)
        live = LiveWorld(
            world,
            wires,
            config.simulation.time_step_ns,
            sources_of(world, course, config, ros, directory),
            partial(CompanionTicks, loops, SIM, TickStream(directory / SOCKET)),
        )

        def over(now_ns: int) -> bool:
            mirror.update()
            return bool(stop) or observer.over(now_ns)

        _answer(ready=True, refused=refused)
        reached_ns = live.run(over)
        wall_s = (time.monotonic_ns() - live.start_ns) * 1e-9
    return {
        **outcome_of(observer, course),
        "fell": observer.fell,
        "fault": "" if not observer.fault else str(observer.fault.name),
        "sim_time_s": reached_ns * 1e-9,
        "wall_time_s": wall_s,
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
