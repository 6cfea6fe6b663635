# SPDX-License-Identifier: Apache-2.0
"""`ugv config`: check a robot's configuration, or print it with everything resolved."""

from __future__ import annotations

import argparse

from runtime.cli.options import add_overrides


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("action", choices=("check", "show"), help="validate, or print the resolved configuration")
    parser.add_argument("robot", metavar="ROBOT|FILE", help="a robot's name, or a TOML file like a robot's own")
    add_overrides(parser)


def run(options: argparse.Namespace) -> int:
    """Check or show; a flaw is a `ConfigError`."""
    from runtime.configuration import dump, parse_overrides
    from runtime.robots import load_configuration

    configuration = load_configuration(options.robot, parse_overrides(options.assignments))
    print(dump(configuration).rstrip() if options.action == "show" else f"{options.robot}: ok")
    return 0
