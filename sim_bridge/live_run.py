# SPDX-License-Identifier: Apache-2.0
"""One scenario against the wall clock, logged and measured."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.executors.resources import Resources
from runtime.executors.runtime_directory import runtime_directory
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording.fault_events import FaultEvent, fault_events
from runtime.recording.log import Log
from runtime.recording.loop_timing import imu_age
from runtime.recording.stepping_again import needed_ns
from runtime.robots import assemble, assembled
from sim_bridge.endurance import check_has_laps
from sim_bridge.live_flaws import flaws
from sim_bridge.live_processes import LiveProcesses, wired
from sim_bridge.observer import Progress
from sim_bridge.process import Task
from sim_bridge.run import with_variant
from sim_bridge.run_bags import RunBags
from sim_bridge.simulation import simulation_of

BEGUN_S, SETTLED_S = 1.0, 120.0
"""When all loops are running, and when all processes have warmed up."""


def run_live(
    robot: str,
    scenario: str,
    *,
    seed: int = 0,
    estimator: str | None = None,
    controller: str | None = None,
    overrides: Mapping[str, str] | None = None,
    out: Path,
    until_s: float = math.inf,
    duration_s: float | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Run a scenario in real time; arguments and result as those of `run_scenario`.

    With `duration_s` the robot walks lap after lap for so long, and after each fault is reset and goes on.

    Raises:
        UgvError: for an unknown robot, scenario or key, laps where there is no path, or a process that ended before
            the run.
    """
    chosen = with_variant(overrides, estimator, controller)
    with runtime_directory() as directory, wired(robot, chosen, directory) as (config, buses):
        if duration_s is not None:
            check_has_laps(simulation_of(config).scenario(scenario, seed))
        print(f"ugv sil: {buses}", file=sys.stderr)
        task = Task(
            "",
            str(Path(scenario).resolve()) if scenario.lower().endswith(".csv") else scenario,
            seed,
            str(directory),
            until_s if math.isfinite(until_s) else None,
            duration_s,
        )
        with LiveProcesses(config, task, out) as live:
            outcome = _watched(live, progress or _unseen)
            live.stop()
    bags = RunBags(out, lambda sentence: print(f"ugv sil: {sentence}", file=sys.stderr))
    bounds = simulation_of(config).stall_bounds()
    events = [fault_events(log, bounds, partial(_needs, log)) for log in bags]
    faults = [told(event) for losses, _ in events for event in losses]
    pauses = [told(event) for _, stands in events for event in stands]
    found = flaws(faults, pauses, outcome["fault"], outcome["resources"], duration_s)
    summary = {
        "robot": robot,
        "scenario": scenario,
        "seed": seed,
        "controller": config.variant.controller,
        "estimator": config.variant.estimator,
        **outcome,
        **timings(bags, [loop.name for loop in assembled(config).loops]),
        "imu_age_ms": imu_age_ms(bags),
        "faults": faults,
        "pauses": pauses,
        "flaws": found,
        "realtime": True,
        "log": bags.longest.path.name,
        "other_logs": [directory.name for directory in bags.others],
    }
    (out / "summary.json").write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2))
    return summary


def _needs(log: Log, loop: str, from_ns: int, to_ns: int) -> Mapping[int, int]:
    return needed_ns(log, assemble(log.robot, log.config), loop, from_ns, to_ns)


def _watched(live: LiveProcesses, progress: Progress) -> dict[str, Any]:
    for sentence in live.refused:
        print(f"ugv sil: the simulator: {sentence}", file=sys.stderr)
    held: list[tuple[float, dict[str, Resources]]] = []
    outcome: dict[str, Any] = {}
    for answer in live.answers():
        outcome = answer.get("outcome", outcome)
        if "progress" in answer:
            progress(*answer["progress"])
            held.append((answer["progress"][0], live.processes.resources()))
            live.processes.check()
    return {**outcome, "resources": growth(held)}


def _unseen(done_s: float, expected_s: float) -> None:
    """Progress that nobody looks at."""


def growth(held: Sequence[tuple[float, Mapping[str, Resources]]]) -> dict[str, Any]:
    """What each process held when its loops ran, after two minutes, and at the end; None if missing.

    Of a run shorter than ten minutes it is after a fifth of it.
    """
    if not held:
        return {}
    settled_s = min(SETTLED_S, 0.2 * held[-1][0])
    begun = next((row for at_s, row in held if at_s >= BEGUN_S), held[-1][1])
    early = next(row for at_s, row in held if at_s >= settled_s)
    samples = {"begun": begun, "early": early, "late": held[-1][1]}
    names = sorted({name for _, row in held for name in row})
    return {name: {when: _figures(row.get(name)) for when, row in samples.items()} for name in names}


def _figures(held: Resources | None) -> dict[str, int] | None:
    return None if held is None else held._asdict()


def told(event: FaultEvent) -> dict[str, Any]:
    """A fault with the stall of the machine that explains it, and the bound of that; None where there is none."""
    bound, stall, slow = event.bound, event.stall, event.slow
    return {
        "at_ns": event.at_ns,
        "fault": str(event.fault.name),
        "cause": str(event.cause.name),
        "bound": bound and {"loops": bound.loops, "ms": bound.bound_ns * 1e-6},
        "stall": stall and {"loop": stall.loop, "ms": stall.length_ns * 1e-6},
        "stalled_ms": event.stalled_ns * 1e-6,
        "slow": slow and {"ticks": slow.ticks, "took_ms": slow.took_ns * 1e-6, "need_ms": slow.need_ns * 1e-6},
    }


def timings(bags: RunBags, loops: Iterable[str]) -> dict[str, Any]:
    """Times of the loops' steps, ms, and how many periods they missed, from the ticks."""
    figures: dict[str, Any] = {}
    missed: dict[str, int] = {}
    for name in loops:
        ticks = bags.read(TICK_TOPIC_PREFIX + name).values
        figures[f"{name}_ms"] = _spread(ticks["compute_ns"])
        missed[name] = int(ticks["skipped"].sum())
    return {**figures, "missed_deadlines": missed}


def imu_age_ms(logs: Iterable[Log]) -> dict[str, float] | None:
    """How old the inertial samples were when they were used, ms; None if none was."""
    age = imu_age(*logs)
    return age and {"median": age.p50 * 1e-6, "p99": age.p99 * 1e-6, "max": age.max * 1e-6}


def _spread(values_ns: npt.NDArray[np.int64]) -> dict[str, float]:
    median, p99, longest = (np.percentile(values_ns, (50, 99, 100)) * 1e-6).tolist()
    return {"median": median, "p99": p99, "max": longest}
