# SPDX-License-Identifier: Apache-2.0
"""`ugv replay`: every task stepped again on what the log says it saw, and compared with what it did then."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from runtime.cli.options import add_overrides, add_run, existing_run, seconds
from runtime.errors import UsageError

if TYPE_CHECKING:
    from runtime.recording.replay_result import ReplayResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_run(parser)
    parser.add_argument("--task", metavar="NAME", help="step this task only, the others' outputs from the log")
    add_overrides(parser)
    parser.add_argument("--from", dest="start_s", type=seconds, default=0.0, metavar="S", help="start, s into the run")
    parser.add_argument("--to", dest="stop_s", type=seconds, default=math.inf, metavar="S", help="end, s into the run")


def run(options: argparse.Namespace) -> int:
    """Replay and print: identical, the first divergence, or how the outputs move."""
    if options.stop_s <= options.start_s:
        raise UsageError(f"ugv replay: --to {options.stop_s:g} is not after --from {options.start_s:g}")
    directory = existing_run(options.directory)
    from runtime.cli.console import progress_bar
    from runtime.configuration import parse_overrides
    from runtime.recording.errors import LogError
    from runtime.recording.log import Log
    from runtime.recording.replay import Replay
    from runtime.recording.replay_result import Comparing
    from runtime.robots import ROBOTS, assemble

    overrides = parse_overrides(options.assignments)
    log = Log(directory)
    if log.robot not in ROBOTS:
        raise LogError(f"{log.path} is a log of {log.robot or 'no robot'}; the robots here are {', '.join(ROBOTS)}")
    loops = assemble(log.robot, log.config, overrides)
    replay = Replay(log, loops, log.robot, Comparing.CHANGE if overrides else None)
    with progress_bar(f"replay {directory}") as progress:
        result = replay.run(
            options.start_s,
            options.stop_s,
            lambda part: progress(part, 1.0),
            None if options.task is None else [options.task],
        )
    _print_result(result)
    return _exit_code(result)


def _exit_code(result: ReplayResult) -> int:
    """A changed run is to differ; any other is not."""
    from runtime.recording.replay_result import Comparing

    if result.comparing is Comparing.CHANGE:
        return 0 if result.steps else 1
    return 0 if result.identical else 1


def _print_result(result: ReplayResult) -> None:
    from runtime.cli.console import print_table
    from runtime.recording.replay_result import Comparing

    changed = result.comparing is Comparing.CHANGE
    stepped = [task for task in result.tasks.values() if task.steps]
    print_table(
        "Tasks",
        ("task", "loop", "steps", "signals", "states", "" if changed else "verdict"),
        [
            (task.task, task.loop, task.steps, task.signals, task.states, "" if changed else task.verdict)
            for task in stepped
        ],
    )
    if result.shifts:
        print_table(
            "How the outputs move" if changed else "Differences",
            ("signal", "field", "steps", "RMS", "largest", "at s"),
            [
                (shift.signal, shift.field, shift.steps, shift.rms, shift.largest, shift.largest_ns / 1e9)
                for shift in result.shifts
            ],
        )
    for sentence in (*result.notes, *result.broken, *map(str, result.damage)):
        print(sentence)
    if result.gaps or len(result.stretches) > len({stretch.loop for stretch in result.stretches}):
        _print_stretches(result)
    if result.recorded:
        print(
            f"{100.0 * result.stepped / result.recorded:.4g} % of {result.recorded} recorded ticks were stepped again"
        )
    print(f"{result.steps} steps, {result.signals} signals compared: {_conclusion(result)}")


def _print_stretches(result: ReplayResult) -> None:
    from runtime.cli.console import print_table

    print_table(
        "Stretches without a gap",
        ("loop", "from s", "to s", "first tick", "last tick", "ticks", "identical"),
        [
            (s.loop, f"{s.begin_ns / 1e9:.3f}", f"{s.end_ns / 1e9:.3f}", s.first, s.last, s.ticks, s.identical)
            for s in result.stretches
        ],
    )
    for gap in result.gaps:
        print(gap)


def _conclusion(result: ReplayResult) -> str:
    from runtime.recording.replay_result import Comparing

    if not result.steps:
        return "nothing could be replayed"
    if result.comparing is Comparing.CHANGE:
        return f"{sum(shift.largest > 0.0 for shift in result.shifts)} fields move"
    if result.first is not None:
        return f"first divergence: {result.first}"
    if not result.identical:
        return "the log was altered"
    verdict = "identical" if result.comparing is Comparing.IDENTITY else "equal within the tolerance"
    return f"{verdict} over every gap-free stretch" if result.gaps else verdict
