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
    for name in sorted(log.attachments):
        print(f"attachment: {name}, {len(log.attachments[name])} bytes")
    if log.truncated:
        print("the log was not closed: this is what is whole of it")
    for place in log.damage:
        print(f"damaged: {place}")


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
