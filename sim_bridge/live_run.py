# SPDX-License-Identifier: Apache-2.0
"""One scenario against the wall clock: control, link, recorder and simulator as processes, on real buses."""

from __future__ import annotations

import json
import math
import shutil
import socket
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np

from runtime.configuration import dump
from runtime.executors.processes import ProcessError, Processes, how_it_ended
from runtime.executors.resources import Resources
from runtime.executors.runtime_directory import runtime_directory
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording.log import Log
from runtime.recording.stalls import fault_events
from runtime.robots import load_configuration
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.observer import Progress
from sim_bridge.process import Task
from sim_bridge.run import chosen_scenario, packed

HUB = "ugv-unix"
SETTLED_S = 120.0
STALL_NS = 5_000_000
"""Shorter stalls are within the bounds of every input."""


def run_live(
    robot: str,
    scenario: str,
    *,
    seed: int = 0,
    estimator: str = "kalman",
    controller: str = "FpMW",
    overrides: Mapping[str, str] | None = None,
    out: Path,
    until_s: float = math.inf,
    duration_s: float | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Run a scenario in real time; arguments and result as those of `run_scenario`.

    With `duration_s` the robot walks lap after lap for so long, and after each fault is reset and goes on.

    Raises:
        UgvError: for an unknown robot, scenario or key, or a process that ended before the run.
    """
    chosen = {**(overrides or {}), "variant.estimator": estimator, "variant.controller": controller}
    course = chosen_scenario(scenario, load_configuration(robot, chosen), seed)
    with runtime_directory() as directory:
        channels = [str(directory / f"can{bus}") for bus in range(load_configuration(robot, chosen).drives.buses)]
        wiring = {
            "drives.interface": HUB,
            "drives.channels": json.dumps(channels),
            "link.listen": json.dumps([f"tcp/127.0.0.1:{_free_port()}"]),
        }
        config = load_configuration(robot, {**chosen, **wiring})
        (directory / "config.toml").write_text(dump(config))
        (directory / "terrain.npz").write_bytes(packed(course.terrain(seed)))
        task = Task(
            str(directory / "config.toml"),
            scenario if not scenario.lower().endswith(".csv") else str(Path(scenario).resolve()),
            seed,
            str(directory),
            until_s if math.isfinite(until_s) else None,
            duration_s,
        )
        outcome = _run(robot, directory, out, task, progress or _unseen)
    _take_log(out)
    summary = {
        "robot": robot,
        "scenario": scenario,
        "seed": seed,
        "controller": controller,
        "estimator": estimator,
        **outcome,
        **_timings(out, config),
        "faults": _faults(out),
        "realtime": True,
        "log": f"{out.resolve().name}_0.mcap",
    }
    (out / "summary.json").write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2))
    return summary


def _run(robot: str, directory: Path, out: Path, task: Task, progress: Progress) -> dict[str, Any]:
    ugv = [sys.executable, "-m", "runtime.cli.main", "run", robot, "--config", task.config]
    ugv += ["--runtime-dir", str(directory), "--log-dir", str(out.resolve()), "--process"]
    with Processes() as processes:
        for name in ("recorder", "link"):
            processes.start(name, [*ugv, name])
            processes.wait_ready(name)
        simulator = processes.start("sim", [sys.executable, "-m", "sim_bridge.process"], piped=True)
        assert simulator.stdin is not None
        assert simulator.stdout is not None
        simulator.stdin.write(msgspec.json.encode(task) + b"\n")
        simulator.stdin.flush()
        answers = _answers(simulator.stdout)
        for sentence in _first(answers, "ready").get("refused", []):
            print(f"ugv sil: the simulator has {sentence}", file=sys.stderr)
        processes.start("control", [*ugv, "control"])
        held: list[tuple[float, dict[str, Resources]]] = []
        for answer in answers:
            if "outcome" in answer:
                outcome: dict[str, Any] = answer["outcome"]
                break
            if "progress" in answer:
                progress(*answer["progress"])
                held.append((answer["progress"][0], processes.resources()))
            processes.check()
        else:
            code = processes.stop("sim")
            raise ProcessError(f"the simulator {how_it_ended(code)} before the run was over")
        for name in ("control", "sim", "link", "recorder"):
            processes.stop(name)
    return {**outcome, "resources": _growth(held)}


def _unseen(done_s: float, expected_s: float) -> None:
    """Progress that nobody looks at."""


def _growth(held: Sequence[tuple[float, Mapping[str, Resources]]]) -> dict[str, Any]:
    """What each process held after two minutes (or a fifth of a shorter run) and at the end."""
    if not held:
        return {}
    settled_s = min(SETTLED_S, 0.2 * held[-1][0])
    early = next(row for at_s, row in held if at_s >= settled_s)
    late = held[-1][1]
    return {name: {"early": early[name]._asdict(), "late": late[name]._asdict()} for name in early.keys() & late.keys()}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _answers(stream: IO[bytes]) -> Iterator[dict[str, Any]]:
    for line in stream:
        yield json.loads(line)


def _first(answers: Iterator[dict[str, Any]], key: str) -> dict[str, Any]:
    for answer in answers:
        if key in answer:
            return answer
    raise ProcessError("the simulator ended before it was ready")


def _take_log(out: Path) -> None:
    """Move the one bag of a run from a directory of its own into that of the run, and name it after that."""
    bags = [path for path in out.iterdir() if path.is_dir()]
    if len(bags) != 1:
        raise ProcessError(f"the recorder made {len(bags)} bags of one run in {out}")
    for file in bags[0].iterdir():
        name = file.name.replace(bags[0].name, out.resolve().name)
        shutil.move(file, out / name)
    bags[0].rmdir()
    metadata = out / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(bags[0].name, out.resolve().name))


def _faults(out: Path) -> list[dict[str, Any]]:
    """Every loss of power by a fault, with the stall of the machine that stands before it in the ticks."""
    found = []
    for event in fault_events(Log(out), STALL_NS):
        stall = event.stall and {"loop": event.stall.loop, "ms": event.stall.length_ns * 1e-6}
        found.append({"at_ns": event.at_ns, "fault": str(event.fault.name), "stall": stall})
    return found


def _timings(out: Path, config: Uslgo1Config) -> dict[str, Any]:
    """Times of the loops' steps, ms, and how many periods they missed, from the ticks."""
    log = Log(out)
    figures: dict[str, Any] = {}
    missed: dict[str, int] = {}
    for name in ("wbc", "mpc"):
        ticks = log.read_signal(TICK_TOPIC_PREFIX + name).values
        median, p99 = np.percentile(ticks["compute_ns"], (50, 99)) * 1e-6
        figures[f"{name}_ms"] = {
            "median": float(median),
            "p99": float(p99),
            "max": float(ticks["compute_ns"].max()) * 1e-6,
        }
        missed[name] = int(ticks["skipped"].sum())
    return {**figures, "missed_deadlines": missed}
