# SPDX-License-Identifier: Apache-2.0
"""`ugv report`: the HTML report of a recorded run, written again."""

from __future__ import annotations

import argparse

from runtime.cli.options import add_run, existing_run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_run(parser)


def run(options: argparse.Namespace) -> int:
    """Write the report and print where it is."""
    directory = existing_run(options.directory)
    from runtime.recording.report import write_report

    print(f"report: {write_report(directory)}")
    return 0
