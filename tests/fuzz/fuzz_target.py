# SPDX-License-Identifier: Apache-2.0
"""What a target is, and what several of them need: a place for files, the tiny robot of the recording tests."""

from __future__ import annotations

import functools
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import DriverError
from runtime.errors import UgvError
from runtime.recording.log import Log

OURS = (UgvError, DriverError)
RECORDING = ("runtime.recording", "mcap")


@dataclass(frozen=True)
class Target:
    """A decoder.

    Attributes:
        name: of the target.
        decode: takes the bytes; raises nothing but `OURS`.
        modules: that coverage is measured in.
        seeds: valid input, to be mutated.
        of_run: more of it, from a recorded run of the robot.
    """

    name: str
    decode: Callable[[bytes], object]
    modules: tuple[str, ...]
    seeds: Callable[[], list[bytes]]
    of_run: Callable[[Log], list[bytes]] = lambda log: []


@functools.cache
def toy() -> Any:
    """The tiny robot of the recording tests."""
    place = Path(__file__).parents[1] / "runtime" / "recording" / "conftest.py"
    spec = importlib.util.spec_from_file_location("toy_robot", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["toy_robot"] = module
    spec.loader.exec_module(module)
    return module.Toy()


@functools.cache
def toy_setup() -> Any:
    """What its recorder is told."""
    return toy().setup()


def memory() -> str | None:
    """Where files are in memory, None if there is no such place."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


@functools.cache
def room() -> Path:
    """A directory in memory, for decoders that take a file."""
    directory = tempfile.TemporaryDirectory(prefix="ugv-fuzz-", dir=os.environ.get("TMPDIR", memory()))
    _KEPT.append(directory)
    return Path(directory.name)


_KEPT: list[Any] = []


@contextmanager
def file_of(data: bytes, name: str) -> Iterator[Path]:
    """The bytes as a file, gone afterwards with what was made beside it."""
    with tempfile.TemporaryDirectory(dir=room()) as directory:
        place = Path(directory) / name
        place.write_bytes(data)
        yield place
