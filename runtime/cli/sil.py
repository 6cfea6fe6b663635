# SPDX-License-Identifier: Apache-2.0
"""`ugv sil`: a scenario in simulation, with every command and measurement on the wires that the robot has."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from runtime.cli.options import add_overrides, seconds, seed
from runtime.errors import RobotFault, UsageError

ESTIMATORS = ("kalman", "truth")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("robot", metavar="ROBOT", help="for example uslgo1")
    parser.add_argument(
        "scenario",
        metavar="SCENARIO",
        nargs="?",
        default="flat",
        help="for example circle-6cm (default flat), or a CSV file with a path: x,y in metres",
    )
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of terrain, noise and pushes (default 0)")
    parser.add_argument("--realtime", action="store_true", help="against the wall clock, on real buses")
    parser.add_argument(
        "--estimator", choices=ESTIMATORS, help="state from the sensors (kalman), or the simulator's own"
    )
    parser.add_argument("--controller", metavar="NAME", help="one of the robot's (default: the one of its TOML)")
    add_overrides(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="new or empty directory (default: a new one in runs/)")
    parser.add_argument(
        "--duration",
        type=seconds,
        metavar="S",
        help="with --realtime: lap after lap for so long; after a fault the robot is reset and goes on",
    )
    parser.add_argument("--view", action="store_true", help="show the robot in a browser (not available yet)")


def run(options: argparse.Namespace) -> int:
    """Run the scenario, write its directory, print its summary."""
    if options.view:
        raise UsageError("ugv sil: --view comes with a later version; without it the run is in virtual time")
    from runtime.cli.console import progress_bar
    from runtime.cli.output import run_directory
    from runtime.cli.summary_table import print_summary
    from runtime.configuration import parse_overrides

    overrides = parse_overrides(options.assignments)
    name = f"{options.robot}-{Path(options.scenario).stem}-{options.seed}"
    with run_directory(options.out, name) as directory:
        with progress_bar(f"{options.robot} {options.scenario}") as progress:
            summary = _chosen(options)(
                options.robot,
                options.scenario,
                seed=options.seed,
                estimator=options.estimator,
                controller=options.controller,
                overrides=overrides,
                out=directory,
                progress=progress,
            )
        from runtime.recording.report import write_report

        report = write_report(directory)
    print_summary(summary)
    print(f"log:    {directory / str(summary.get('log', ''))}")
    print(f"report: {report}")
    return exit_code(summary)


def _chosen(options: argparse.Namespace) -> Callable[..., dict[str, Any]]:
    if options.realtime:
        return partial(simulate_live, duration_s=options.duration)
    if options.duration is not None:
        raise UsageError("ugv sil: --duration is for runs against the wall clock; add --realtime")
    return simulate


def simulate(robot: str, scenario: str, **options: Any) -> dict[str, Any]:
    """Run one scenario and return the content of its `summary.json`."""
    import msgspec

    from sim_bridge.run import run_scenario

    summary: dict[str, Any] = msgspec.to_builtins(run_scenario(robot, scenario, **options))
    return summary


def simulate_live(robot: str, scenario: str, **options: Any) -> dict[str, Any]:
    """Run one scenario in real time and return the content of its `summary.json`."""
    import msgspec

    from sim_bridge.live_run import run_live

    summary: dict[str, Any] = msgspec.to_builtins(run_live(robot, scenario, **options))
    return summary


def exit_code(summary: Mapping[str, Any]) -> int:
    """What a run's outcome means to the shell."""
    if summary.get("fault"):
        return RobotFault.exit_code
    return 0 if summary["completed"] and not summary["fell"] and not summary.get("flaws") else 1
