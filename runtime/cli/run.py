# SPDX-License-Identifier: Apache-2.0
"""`ugv run`: the service on the robot, one process of it or all of them."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.options import add_overrides
from runtime.errors import OutputError, UsageError

if TYPE_CHECKING:
    from runtime.recording.kept_setup import Prepared
    from runtime.robots.robot_config import RobotConfig

PROCESSES = ("recorder", "link", "control")
"""In the order in which they are started."""
DEFAULT_RUNTIME_DIRECTORY, DEFAULT_LOG_DIRECTORY = "/run/ugv", "runs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("robot", metavar="ROBOT", help="for example uslgo1")
    parser.add_argument("--config", type=Path, metavar="FILE", help="configuration (default: the one of the robot)")
    parser.add_argument("--process", choices=PROCESSES, help="only this one; without it, all, in one session")
    parser.add_argument(
        "--runtime-dir",
        type=Path,
        metavar="DIR",
        default=Path(os.environ.get("RUNTIME_DIRECTORY", DEFAULT_RUNTIME_DIRECTORY)),
        help="where the processes meet (default: RUNTIME_DIRECTORY, else /run/ugv)",
    )
    parser.add_argument(
        "--log-dir",
        type=Path,
        metavar="DIR",
        default=Path(os.environ.get("LOGS_DIRECTORY", DEFAULT_LOG_DIRECTORY)),
        help="where runs are recorded (default: LOGS_DIRECTORY, else runs)",
    )
    add_overrides(parser)


def run(options: argparse.Namespace) -> int:
    """Run what is asked for until it is told to stop."""
    parts: dict[str | None, Callable[[argparse.Namespace], int]] = {
        "control": _control,
        "link": _link,
        "recorder": _recorder,
        None: _all,
    }
    return parts[options.process](options)


def _tell(sentence: str) -> None:
    """Say a sentence by one write, line end included, so that those of two threads stay apart."""
    sys.stderr.write(f"{sentence}\n")
    sys.stderr.flush()


def _configuration(options: argparse.Namespace) -> RobotConfig:
    from runtime.configuration import parse_overrides
    from runtime.robots import load_configuration

    source = str(options.config) if options.config is not None else options.robot
    config = load_configuration(source, parse_overrides(options.assignments))
    if config.robot != options.robot:
        raise UsageError(f"ugv run: {options.config} is a configuration of {config.robot}, not of {options.robot}")
    return config


def _make_meeting_place(options: argparse.Namespace) -> None:
    try:
        options.runtime_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"--runtime-dir {options.runtime_dir}: cannot be made ({error.strerror}); give another one"
        ) from None


def _control(options: argparse.Namespace) -> int:
    from runtime.executors.control import control
    from runtime.robots import assembled, rehearse

    config = _configuration(options)
    _make_meeting_place(options)
    rehearse(config)
    control(
        assembled(config),
        config.drives.interface,
        config.drives.channels,
        options.runtime_dir,
        config.drives.command_age_max_ns,
        config.realtime.control_processors,
        config.realtime.control_switch_interval_us,
        config.realtime.exit_latency_max_us,
        config.realtime.control_wake_early_us,
        lambda sentence: _tell(f"ugv control: {sentence}"),
    )
    return 0


def _link(options: argparse.Namespace) -> int:
    import signal
    import threading

    from runtime.link.process import run as carry
    from runtime.link.setup import link_setup

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    setup = link_setup(_configuration(options))
    _make_meeting_place(options)
    carry(setup, options.runtime_dir, stop, lambda sentence: _tell(f"ugv {sentence}"))
    return 0


def _recorder(options: argparse.Namespace) -> int:
    from runtime.recording.kept_setup import kept_setup, origin
    from runtime.recording.service import serve

    _make_meeting_place(options)
    file, terrain = options.config, options.runtime_dir / "terrain.npz"
    content = file.read_bytes() if file is not None and file.is_file() else b""
    chosen = (options.robot.encode(), str(file).encode(), content, *(part.encode() for part in options.assignments))
    prepared = kept_setup(options.runtime_dir, origin(*chosen), lambda: _prepared(_configuration(options)))
    files = [terrain] if terrain.exists() else []
    serve(prepared.setup, options.runtime_dir, options.log_dir, files, prepared.priority)
    return 0


def _prepared(config: RobotConfig) -> Prepared:
    from runtime.configuration import dump
    from runtime.executors.companions import SIM
    from runtime.link.loop import link_loop
    from runtime.recording.kept_setup import Prepared
    from runtime.recording.setup import recording_setup
    from runtime.robots import assembled

    robot, link = assembled(config), link_loop(config.link, config.realtime.link_priority)
    setup = recording_setup((*robot.loops, link, SIM), robot.name, dump(config), 0, robot.joint_names)
    return Prepared(setup, config.realtime.recorder_priority)


def _all(options: argparse.Namespace) -> int:
    """Keep all processes running until this one is told to stop."""
    import signal

    from runtime.cli.session import run_session

    _configuration(options)
    _make_meeting_place(options)
    told: list[int] = []  # not a threading.Event: waiting for it holds a lock, which the handler would then wait for
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: told.append(number))
    command = [sys.executable, "-m", "runtime.cli.main", "run", options.robot]
    command += ["--runtime-dir", str(options.runtime_dir), "--log-dir", str(options.log_dir)]
    command += ["--config", str(options.config)] if options.config is not None else []
    command += [part for assignment in options.assignments for part in ("--set", assignment)]
    run_session([*command, "--process"], lambda: bool(told), lambda sentence: _tell(f"ugv run: {sentence}"))
    return 0
