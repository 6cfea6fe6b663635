# SPDX-License-Identifier: Apache-2.0
"""What is read from files and command lines: configurations, paths, what a recorder left for the next one."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from fuzz_target import Target, file_of, room, toy_setup

from runtime.configuration import dump, loads, parse_overrides
from runtime.recording.kept_setup import SETUP_FILE, Prepared, kept_setup
from runtime.recording.recorder_status import STATUS_FILE, RecorderStatus, read_status
from runtime.robots import load_configuration
from runtime.robots.robot_config import RobotConfig
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.tracking.path_csv import read_path_csv

ORIGIN = "a"

SCHEMAS: dict[str, type[RobotConfig]] = {"uslgo1": Uslgo1Config, "4ws4wd": Vehicle4ws4wdConfig}


@functools.cache
def config_text(robot: str) -> str:
    """The configuration that comes with a robot."""
    return dump(load_configuration(robot))


def decode_config(robot: str) -> Callable[[bytes], None]:
    """A configuration; one that is accepted says the same when it is written and read again."""

    def decode(data: bytes) -> None:
        config = loads(data.decode(errors="replace"), SCHEMAS[robot], place="fuzz")
        assert loads(dump(config), SCHEMAS[robot], place="fuzz") == config

    return decode


def decode_overrides(data: bytes) -> None:
    """`--set` for each line."""
    overrides = parse_overrides(data.decode(errors="replace").split("\n"))
    loads(config_text("uslgo1"), Uslgo1Config, place="fuzz", overrides=overrides)


def decode_path(data: bytes) -> None:
    """A path file."""
    with file_of(data, "path.csv") as place:
        points = read_path_csv(place, capacity=100)
        assert np.isfinite(points).all()
        assert 2 <= len(points) <= 100


def decode_status(data: bytes) -> None:
    """What another process says of the recorder."""
    with file_of(data, STATUS_FILE) as place:
        assert isinstance(read_status(place.parent), (RecorderStatus, type(None)))


def decode_kept_setup(data: bytes) -> None:
    """What a recorder left for the one that is started in its place."""
    made = Prepared(toy_setup(), 1)
    with file_of(data, SETUP_FILE) as place:
        assert isinstance(kept_setup(place.parent, ORIGIN, lambda: made), Prepared)
        again = kept_setup(place.parent, ORIGIN, lambda: made)
        assert kept_setup(place.parent, ORIGIN, lambda: made) == again, "what is kept is read, or made anew and kept"


def kept_setup_seeds() -> list[bytes]:
    """One that is taken up, and one of another origin."""
    found = []
    for origin in (ORIGIN, "another"):
        with tempfile.TemporaryDirectory(dir=room()) as directory:
            kept_setup(Path(directory), origin, lambda: Prepared(toy_setup(), 1))
            found.append((Path(directory) / SETUP_FILE).read_bytes())
    return found


CONFIGURATION = ("runtime.configuration", "tomllib")

TARGETS = (
    Target("config", decode_config("uslgo1"), CONFIGURATION, lambda: [config_text("uslgo1").encode()]),
    Target("config_4ws4wd", decode_config("4ws4wd"), CONFIGURATION, lambda: [config_text("4ws4wd").encode()]),
    Target(
        "overrides",
        decode_overrides,
        ("runtime.configuration",),
        lambda: [b"gait.period_ns=500000000\nvariant.controller=FpM"],
    ),
    Target("path", decode_path, ("runtime.tracking.path_csv",), lambda: [b"x,y\n0,0\n1.5,2\n# c\n-1e1, 2\n"]),
    Target("status", decode_status, ("runtime.recording.recorder_status",), lambda: [b'{"bags": 1, "error": "e"}']),
    Target("kept_setup", decode_kept_setup, ("runtime.recording.kept_setup",), kept_setup_seeds),
)
