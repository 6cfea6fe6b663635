# SPDX-License-Identifier: Apache-2.0
"""Arguments that several verbs share."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from runtime.errors import UsageError


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add `--set KEY=VALUE`."""
    parser.add_argument(
        "--set",
        dest="assignments",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="replace one value of the robot's configuration, as in wbc.rate_hz=400; may be repeated",
    )


def add_run(parser: argparse.ArgumentParser) -> None:
    """Add the directory of a recorded run."""
    parser.add_argument("directory", metavar="RUN", type=Path, help="directory of a recorded run")


def existing_run(directory: Path) -> Path:
    """The directory of a run, if there is one.

    Raises:
        UsageError: if nothing is there.
    """
    if not directory.exists():
        raise UsageError(f"{directory}: there is no such run")
    return directory


def seed(text: str) -> int:
    """A seed from the command line."""
    number = int(text)
    if not 0 <= number < 1 << 32:
        raise argparse.ArgumentTypeError(f"{number} is not from 0 to 4294967295")
    return number


def seconds(text: str) -> float:
    """A time within a run from the command line."""
    number = float(text)
    if not (math.isfinite(number) and number >= 0.0):
        raise argparse.ArgumentTypeError(f"{text} is not a time from 0 s on")
    return number


def positive(text: str) -> int:
    """A count from the command line."""
    number = int(text)
    if not 1 <= number <= 1_000_000:
        raise argparse.ArgumentTypeError(f"{number} is not from 1 to 1000000")
    return number
