# SPDX-License-Identifier: Apache-2.0
"""`ugv log`: what is in a log, and what a cut-off one still holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.options import add_run, existing_run
from runtime.errors import OutputError

if TYPE_CHECKING:
    from runtime.recording.log import Log
    from runtime.recording.loop_timing import Percentiles


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("action", choices=("info", "recover"), help="list the content, or save what is whole")
    add_run(parser)


def run(options: argparse.Namespace) -> int:
    """List or recover."""
    path = existing_run(options.directory)
    from runtime.recording.log import Log

    log = Log(path)
    if options.action == "info":
        _print_info(log)
    else:
        print(f"recovered: {_recover(log, path)}")
    return 0


def _print_info(log: Log) -> None:
    from runtime.cli.console import print_table
    from runtime.recording.beginning import beginning, clock_changes

    duration_s = (log.end_ns - log.start_ns) / 1e9
    counts = log.counts()
    print_table(
        str(log.path),
        ("topic", "type", "messages", "Hz"),
        [
            (topic, log.channels[topic].type_name, count, count / duration_s if duration_s > 0.0 else None)
            for topic, count in sorted(counts.items())
        ],
    )
    print(f"robot: {log.robot or 'not said'}")
    print(f"duration: {duration_s:.3f} s, {sum(counts.values())} messages")
    _print_loops(log)
    _print_imu_age(log)
    for name in sorted(log.attachments):
        print(f"attachment: {name}, {len(log.attachments[name])} bytes")
    for sentence in (beginning(log), *clock_changes(log)):
        if sentence:
            print(sentence)
    if log.truncated:
        print("the log was not closed: this is what is whole of it")
    for place in log.damage:
        print(f"damaged: {place}")


def _print_loops(log: Log) -> None:
    """How each loop kept its time, and what is missing of it."""
    from runtime.cli.console import print_table
    from runtime.recording.loop_timing import read_loop_times

    times = read_loop_times(log)
    if not times:
        return
    print_table(
        "Loops, times in us",
        ("loop", "Hz", "ticks", "wake p50", "p99", "p99.9", "max", "compute p50", "p99", "max", *_LOOP_COUNTS),
        [
            (
                one.loop.name,
                1e9 / one.loop.period_ns,
                one.ticks,
                *(_microseconds(one.wake, "p50", "p99", "p999", "max")),
                *(_microseconds(one.compute, "p50", "p99", "max")),
                one.skipped,
                one.late,
                one.missing,
                len(one.late_wakes),
            )
            for one in times
        ],
    )
    for one in times:
        _print_some("gaps", list(map(str, one.gaps)))
        worst = sorted(one.late_wakes, key=lambda wake: -wake.late_ns)
        _print_some(
            f"late wakes of {one.loop.name} beyond {one.late_wake_bound_ns / 1e6:g} ms",
            [f"{wake.loop} woke {wake.late_ns / 1e6:,.1f} ms late at {wake.begin_ns / 1e9:.3f} s" for wake in worst],
        )


_LOOP_COUNTS = ("skipped", "late", "missing", "late wakes")
_SHOWN = 10


def _microseconds(times: Percentiles | None, *names: str) -> list[float | None]:
    return [None if times is None else getattr(times, name) / 1e3 for name in names]


def _print_some(what: str, sentences: list[str]) -> None:
    """The first few, and how many more there are."""
    for sentence in sentences[:_SHOWN]:
        print(sentence)
    if len(sentences) > _SHOWN:
        print(f"... and {len(sentences) - _SHOWN} more {what}")


def _print_imu_age(log: Log) -> None:
    from runtime.recording.loop_timing import imu_age

    age = imu_age(log)
    if age is not None:
        print(
            f"age of the IMU samples that the estimator used: p50 {age.p50 / 1e6:.3g}, p99 {age.p99 / 1e6:.3g}, "
            f"p99.9 {age.p999 / 1e6:.3g}, max {age.max / 1e6:.3g} ms"
        )


def _recover(log: Log, path: Path) -> Path:
    """Save beside the run, under a name of its own."""
    from runtime.cli.console import progress_bar
    from runtime.recording.recover import recover

    run = (path if path.is_dir() else path.parent).resolve()
    directory = run.with_name(f"{run.name}-recovered")
    if directory.exists():
        raise OutputError(f"{directory}: already exists; move it away to recover once more")
    with progress_bar("recover") as progress:
        return recover(log, directory, lambda part: progress(part, 1.0))
