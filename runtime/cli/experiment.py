# SPDX-License-Identifier: Apache-2.0
"""`ugv experiment`: a paper's table reproduced; the table of faults, tried; real time beside lockstep."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from runtime.cli.experiment_paper_002 import PLANTS, run_paper_002
from runtime.cli.experiment_realtime import SEEDS, run_realtime
from runtime.cli.options import positive
from runtime.errors import UsageError, unknown


class Printed(NamedTuple):
    """What paper 000 reports of the S-curve: tracking error and time to completion (section 5, on the real robot)."""

    mean_m: float
    std_m: float
    time_s: float


S_CURVE = {
    "FpMW": Printed(0.2801, 0.1957, 64.0),
    "FpM": Printed(0.2933, 0.1981, 68.0),
    "pMW": Printed(0.5133, 0.3822, 75.0),
}
EXPERIMENTS = ("paper-000", "paper-002", "faults", "realtime")
OURS, BASELINE = "FpMW", "pMW"
SIMULATIONS = {"line-3cm": None, "line-6cm": None, "circle-6cm": 62.0}
"""The paper's simulations, and the time (s) that it reports of one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("name", metavar="NAME", help="paper-000, paper-002, faults or realtime")
    parser.add_argument("--seeds", type=positive, metavar="N", help="runs of each comparison (10, 1, 8), or fault (3)")
    parser.add_argument("--realtime", action="store_true", help="faults: against the wall clock, processes included")
    parser.add_argument(
        "--plant",
        choices=PLANTS,
        help="paper-002: only on this one; on 2 processors kinematic takes 1 to 2 minutes, mujoco 45 a seed",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="paper-002: of a seed's 270 drives in MuJoCo the 16 that tell most, in 3 minutes",
    )
    parser.add_argument("--only", metavar="TEXT", default="", help="faults with --realtime: those so named")
    parser.add_argument(
        "--robot", metavar="ROBOT", help="whose faults (default: of both robots), or realtime: whose (default: uslgo1)"
    )
    parser.add_argument(
        "--scenarios", nargs="+", default=(), metavar="SCENARIO", help="realtime: which (default: three of the robot's)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="of paper-002's report, or of logs of runs in real time"
    )


def run(options: argparse.Namespace) -> int:
    """Run the experiment and print its tables."""
    if options.name not in EXPERIMENTS:
        raise UsageError("ugv experiment: " + unknown("experiment", options.name, EXPERIMENTS))
    if options.name == "faults":
        from runtime.cli.experiment_faults import run_faults, run_live_faults

        if options.realtime:
            return run_live_faults(options.robot, options.seeds or 1, options.only, options.out)
        return run_faults(options.robot, options.seeds or 3)
    if options.name == "paper-002":
        plants = (options.plant,) if options.plant else PLANTS
        return run_paper_002(plants, options.seeds or 1, options.quick, options.out)
    if options.name == "realtime":
        return run_realtime(options.robot or "uslgo1", options.scenarios, options.seeds or SEEDS, options.out)
    return compare_controllers(options.seeds or 10)


def compare_controllers(seeds: int) -> int:
    """Walk the paper's courses.

    What the other controllers do is reported as it comes out; the exit code is that of ours.
    """
    from runtime.cli.batch import Job, run_jobs
    from runtime.cli.console import print_table, progress_bar

    simulations = [Job(scenario) for scenario in SIMULATIONS]
    comparisons = [Job("s-curve", seed, controller=name) for name in S_CURVE for seed in range(seeds)]
    with progress_bar("paper-000") as progress:
        summaries = run_jobs([*simulations, *comparisons], progress)
    print_table(
        "Simulations 1 to 3, FpMW, seed 0",
        ("scenario", "completed", "time s", "paper", "speed m/s", "error mean m", "error std m", "lateral RMS m"),
        [_simulation_row(summary) for summary in summaries[: len(simulations)]],
    )
    of_controller = {
        name: [summary for summary in summaries[len(simulations) :] if summary["controller"] == name]
        for name in S_CURVE
    }
    print_table(
        f"S-curve, {seeds} seed{'' if seeds == 1 else 's'} each",
        ("controller", "completed", "error mean m", "paper", "error std m", "paper", "time s", "paper"),
        [_comparison_row(name, of_controller[name]) for name in S_CURVE],
    )
    print_table(
        f"S-curve, ratios to {BASELINE} (the paper's figures are of its robot outdoors, Table 5)",
        ("controller", "error mean", "paper", "error std", "paper", "time", "paper"),
        [_ratio_row(name, of_controller[name], of_controller[BASELINE]) for name in S_CURVE if name != BASELINE],
    )
    ours = [*summaries[: len(simulations)], *of_controller[OURS]]
    return 0 if all(summary["completed"] and not summary["fell"] for summary in ours) else 1


def average(summaries: Sequence[dict[str, Any]]) -> Printed | None:
    """Mean over the runs that were completed; None if none was."""
    completed = [summary for summary in summaries if summary["completed"]]
    if not completed:
        return None
    return Printed(
        fmean(summary["tracking_error_m"]["mean"] for summary in completed),
        fmean(summary["tracking_error_m"]["std"] for summary in completed),
        fmean(summary["completion_time_s"] for summary in completed),
    )


def _simulation_row(summary: dict[str, Any]) -> tuple[Any, ...]:
    error = summary["tracking_error_m"]
    return (
        summary["scenario"],
        summary["completed"],
        summary["completion_time_s"],
        SIMULATIONS[summary["scenario"]],
        summary["speed_mps"]["mean"],
        error["mean"],
        error["std"],
        summary["lateral_error_m"]["rms"],
    )


def _comparison_row(name: str, summaries: Sequence[dict[str, Any]]) -> tuple[Any, ...]:
    measured, printed = average(summaries) or (None, None, None), S_CURVE[name]
    completed = sum(summary["completed"] for summary in summaries)
    pairs = zip(measured, printed, strict=True)
    return (name, f"{completed} of {len(summaries)}", *(figure for pair in pairs for figure in pair))


def _ratio_row(name: str, summaries: Sequence[dict[str, Any]], baseline: Sequence[dict[str, Any]]) -> tuple[Any, ...]:
    ours, theirs = average(summaries), average(baseline)
    cells: list[Any] = [name]
    for index, (printed, printed_baseline) in enumerate(zip(S_CURVE[name], S_CURVE[BASELINE], strict=True)):
        cells += [ours[index] / theirs[index] if ours and theirs else None, printed / printed_baseline]
    return tuple(cells)
