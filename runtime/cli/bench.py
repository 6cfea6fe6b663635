# SPDX-License-Identifier: Apache-2.0
"""`ugv bench`: figures with percentiles, each beside what it is compared with. Only `rt` has claims that it may fail.

The loops are measured where they are replayed: on the inputs of a recorded run, in one process, with one thread for
linear algebra. A yardstick of plain numpy, measured in the same minute, tells a slow machine from slow code.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter_ns
from typing import Any

from runtime.cli.options import positive
from runtime.errors import UsageError

ROBOT, SCENARIO, STANDING = "uslgo1", "circle-6cm", "stand"
REAL_TIME, SLICES = "rt", 12
RECORDED_S = 15.0
SETTLED_NS = 1_500_000_000
"""Ticks before this are those of a robot that has not begun to walk."""
YARDSTICK_SIZE, YARDSTICK_RUNS = 60, 2000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("part", choices=(REAL_TIME, *PARTS), help="what to measure")
    parser.add_argument("--slices", type=positive, metavar="N", help=f"of five seconds each, for `rt` ({SLICES})")


def run(options: argparse.Namespace) -> int:
    """Measure and print; 1 if a claim about real time is not kept."""
    if options.part == REAL_TIME:
        from runtime.cli.bench_rt import run as run_in_real_time

        return run_in_real_time(options.slices or SLICES)
    if options.slices is not None:
        raise UsageError(f"ugv bench {options.part}: --slices is for `ugv bench {REAL_TIME}` alone")
    PARTS[options.part]()
    return 0


def percentiles(samples: Sequence[float]) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum."""
    import numpy as np

    median, high = np.percentile(samples, (50.0, 99.0))
    return float(median), float(high), float(np.max(samples))


@contextlib.contextmanager
def no_collection() -> Iterator[None]:
    """Without garbage collection, as the loops run on the robot."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def yardstick_ms() -> list[float]:
    """Wall times of one dense linear solve of numpy of about the MPC's size."""
    import numpy as np

    matrix = np.random.default_rng(0).normal(size=(YARDSTICK_SIZE, YARDSTICK_SIZE))
    matrix = matrix @ matrix.T + YARDSTICK_SIZE * np.eye(YARDSTICK_SIZE)
    right = np.ones(YARDSTICK_SIZE)
    times = []
    for _ in range(YARDSTICK_RUNS):
        began = perf_counter_ns()
        np.linalg.solve(matrix, right)
        times.append((perf_counter_ns() - began) / 1e6)
    return times


def _mpc() -> None:
    """The step of the MPC on recorded inputs, with the robot's solver and with the other one."""
    with recorded(SCENARIO) as walked, recorded(STANDING) as stood:
        names = {"daqp": ["proxqp"], "proxqp": ["daqp"]}
        chosen = _solver(walked)
        rows: list[tuple[Any, ...]] = []
        for solver in (chosen, *names[chosen]):
            for what, run_directory, standing in ((SCENARIO, walked, False), ("all-stance", stood, True)):
                times = mpc_times_ms(run_directory, {"variant.solver": solver}, standing)
                rows.append((f"{what}, {solver}", len(times), *percentiles(times)))
    print_times(
        "MPC: reference, prediction, build and solve, N = 10, ms (claimed: p99 at most 3, aim 1.5)",
        rows,
        reference=rows[0],
    )


def mpc_times_ms(run_directory: Path, overrides: Mapping[str, str], standing: bool) -> list[float]:
    """Wall times of the MPC's steps that made a plan, replayed from a log.

    Args:
        run_directory: of the log.
        overrides: changes to its configuration.
        standing: those plans in which every foot stands throughout, or the others.
    """
    from runtime.robots import topics

    _, tasks, log = _replayed(run_directory, ["mpc"], overrides)
    plans = log.read_signal(topics.CONTACT_FORCES)
    planned = {
        int(at)
        for at, plan, stance in zip(plans.log_ns, plans.values["stamp_ns"], plans.values["stance"], strict=True)
        if plan > at and bool(stance.all()) == standing
    }
    return [taken / 1e6 for now_ns, taken in tasks["mpc"].steps if now_ns in planned]


def _wbc() -> None:
    """The tick of the fast loop on recorded inputs, and what its tasks take of it."""
    import numpy as np

    from runtime.cli.console import print_table

    with recorded(SCENARIO) as walked:
        loops, tasks, log = _replayed(walked, None, {})
        names = [item.task.name for loop in loops if loop.name == "wbc" for item in loop.schedule]
        taken = np.array([[t for now, t in tasks[name].steps if now >= SETTLED_NS] for name in names]) / 1e6
        live = log.read_signal("/ugv/tick/wbc")
        live_ms = live.values["compute_ns"][live.log_ns >= SETTLED_NS] / 1e6
    tick = taken.sum(axis=0)
    rows: list[tuple[Any, ...]] = [
        (f"tick on {SCENARIO}, replayed", tick.size, *percentiles(tick.tolist())),
        (f"tick on {SCENARIO}, in the run itself", live_ms.size, *percentiles(live_ms.tolist())),
    ]
    print_times("WBC tick, ms (claimed: median at most 0.8 and p99 1.6, aim 0.4 and 0.8)", rows, reference=rows[0])
    print_table(
        "Its tasks, ms",
        ("task", "median", "p99", "max", "share %"),
        [
            (name, *percentiles(part.tolist()), 100.0 * float(part.sum() / tick.sum()))
            for name, part in zip(names, taken, strict=True)
        ],
    )


def _fuzzy() -> None:
    """Time of one inference, and its largest difference from all 49 rules evaluated densely."""
    import numpy as np

    from runtime.cli.console import print_table
    from runtime.tracking.fuzzy import infer

    inputs = [(float(e), float(ec)) for e, ec in np.random.default_rng(0).uniform(-3.2, 3.2, (20_000, 2))]
    sparse_us, dense_us, difference = [], [], 0.0
    with no_collection():
        for e, ec in inputs:
            start = perf_counter_ns()
            infer(e, ec)
            sparse_us.append((perf_counter_ns() - start) / 1e3)
        for e, ec in inputs[:2000]:
            start = perf_counter_ns()
            dense_inference(e, ec)
            dense_us.append((perf_counter_ns() - start) / 1e3)
    for e, ec in ((e / 20.0, ec / 20.0) for e in range(-60, 61) for ec in range(-60, 61)):
        difference = max(difference, *(abs(a - b) for a, b in zip(infer(e, ec), dense_inference(e, ec), strict=True)))
    ours, dense = percentiles(sparse_us), percentiles(dense_us)
    print_table(
        "Fuzzy inference, us (claimed: at most 15, aim 5)",
        ("", "median", "p99", "max", "times ours"),
        [("the rules that fire", *ours, 1.0), ("all rules, dense seven-point Mamdani", *dense, dense[0] / ours[0])],
    )
    print(f"largest difference between the two on a grid of 121 x 121 points: {difference:.2g}")


def dense_inference(e: float, ec: float) -> tuple[float, float]:
    """Max-min over all 49 rules and the seven-point sum, as eq 19-21 are printed; the yardstick of the fast form."""
    import numpy as np

    from runtime.tracking.fuzzy import TABLE_K_V, TABLE_K_W, parse_table

    centers = np.arange(-3.0, 4.0)

    def membership(value: float) -> Any:
        return np.maximum(0.0, 1.0 - np.abs(np.clip(value, -3.0, 3.0) - centers))

    firing = np.minimum.outer(membership(e), membership(ec))
    outputs = []
    for text in (TABLE_K_V, TABLE_K_W):
        conclusions = np.array(parse_table(text))
        weights = np.array([np.max(firing[conclusions == point], initial=0.0) for point in range(7)])
        outputs.append(float(weights @ centers / weights.sum()))
    return outputs[0], outputs[1]


def _sil() -> None:
    """The real-time factor of a whole run, and where its time goes."""
    from runtime.cli.console import print_table, progress_bar
    from runtime.cli.sil import simulate

    with progress_bar(f"{ROBOT} {SCENARIO}") as progress:
        summary = simulate(ROBOT, SCENARIO, progress=progress)
    factor = summary["realtime_factor"]
    print_table(
        f"Lockstep on {SCENARIO}, one process, nothing recorded (claimed: at least 1.5 times real time, aim 2.5)",
        ("", "simulated s", "wall s", "real-time factor", "times real time"),
        [
            (ROBOT, summary["sim_time_s"], summary["wall_time_s"], factor, factor),
            ("the robot itself", summary["sim_time_s"], summary["sim_time_s"], 1.0, 1.0),
        ],
    )
    print(
        f"median step: {summary['wbc_ms']['median']:.3g} ms of WBC every 2 ms, {summary['mpc_ms']['median']:.3g} ms "
        "of MPC every 20 ms; the rest is physics, drives and sensors"
    )


@contextlib.contextmanager
def recorded(scenario: str, seconds: float = RECORDED_S, overrides: Mapping[str, str] | None = None) -> Iterator[Path]:
    """The directory of a short recorded run, gone afterwards.

    Args:
        scenario: its name.
        seconds: how much of it.
        overrides: changes to the configuration.
    """
    from runtime.cli.console import progress_bar
    from runtime.cli.sil import simulate

    with tempfile.TemporaryDirectory(prefix="ugv-bench-") as parent:
        directory = Path(parent) / scenario
        directory.mkdir()
        changes = "".join(f", {key} = {value}" for key, value in (overrides or {}).items())
        with progress_bar(f"record {scenario}{changes}") as progress:
            simulate(ROBOT, scenario, overrides=overrides, out=directory, until_s=seconds, progress=progress)
        yield directory


def _replayed(run_directory: Path, names: Sequence[str] | None, overrides: Mapping[str, str]) -> Any:
    """Replay tasks with a stop watch; gives the loops, the timed tasks by name, and the log."""
    from runtime.cli.console import progress_bar
    from runtime.cli.timed_task import timed
    from runtime.recording.log import Log
    from runtime.recording.replay import Replay
    from runtime.recording.replay_result import Comparing
    from runtime.robots import assemble

    log = Log(run_directory)
    loops, tasks = timed(assemble(log.robot, log.config, overrides))
    with progress_bar("replay") as progress, no_collection():
        comparing = Comparing.CHANGE if overrides else None
        Replay(log, loops, log.robot, comparing).run(progress=lambda part: progress(part, 1.0), tasks=names)
    return loops, tasks, log


def _solver(run_directory: Path) -> str:
    from runtime.configuration import loads
    from runtime.recording.log import Log
    from runtime.robots.uslgo1.config import Uslgo1Config

    return loads(Log(run_directory).config, Uslgo1Config, place="the log's configuration").variant.solver


def print_times(title: str, rows: Sequence[tuple[Any, ...]], reference: tuple[Any, ...]) -> None:
    """Print rows of name, number, median, p99 and maximum, and the yardstick; all with ratios to the reference."""
    from runtime.cli.console import print_table

    yardstick = yardstick_ms()
    row = (f"yardstick: numpy solve of {YARDSTICK_SIZE} x {YARDSTICK_SIZE}", len(yardstick), *percentiles(yardstick))
    print_table(
        title,
        ("", "samples", "median", "p99", "max", "median, ratio to the first"),
        [(*entry, entry[2] / reference[2]) for entry in (*rows, row)],
    )


def _tracker() -> None:
    """The vehicle's tracker with each controller."""
    from runtime.cli.bench_tracker import measure

    measure()


PARTS: dict[str, Callable[[], None]] = {
    "mpc": _mpc,
    "wbc": _wbc,
    "fuzzy": _fuzzy,
    "tracker": _tracker,
    "sil": _sil,
}
