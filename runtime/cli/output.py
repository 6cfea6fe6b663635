# SPDX-License-Identifier: Apache-2.0
"""Where a run is written: a new directory each time, so that nothing already recorded is lost."""

from __future__ import annotations

import contextlib
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from runtime.errors import OutputError

RUNS = Path("runs")
_MOST_RUNS = 100_000


@contextlib.contextmanager
def run_directory(asked: Path | None, name: str) -> Iterator[Path]:
    """Create the directory of a run; if the run ends with an error and has written nothing, it goes again.

    Args:
        asked: what `--out` said: a directory that is new or empty. None for the next free one below `runs/`.
        name: of the run, for that free one.

    Raises:
        OutputError: if nothing can be written there, or something has been.
    """
    directory, created = _claim(asked) if asked is not None else (_next_free(name), True)
    try:
        _try_writing(directory)
        yield directory
    finally:
        if created:
            with contextlib.suppress(OSError):
                directory.rmdir()


def _claim(directory: Path) -> tuple[Path, bool]:
    try:
        created = not directory.exists()
        if directory.exists() and not directory.is_dir():
            raise OutputError(f"--out {directory}: is not a directory")
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise OutputError(f"--out {directory}: already holds files; choose a new or an empty directory")
    except (OSError, ValueError) as error:
        raise OutputError(f"--out {directory}: cannot be written to: {_reason(error)}") from None
    return directory, created


def _next_free(name: str) -> Path:
    stem = re.sub(r"[^A-Za-z0-9._-]", "_", name)
    for number in range(1, _MOST_RUNS):
        directory = RUNS / (stem if number == 1 else f"{stem}-{number}")
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            if not RUNS.is_dir():
                raise OutputError(f"{RUNS}: is not a directory; give another one with --out") from None
            continue
        except OSError as error:
            raise OutputError(
                f"{directory}: cannot be created: {_reason(error)}; give another one with --out"
            ) from None
        return directory
    raise OutputError(f"{RUNS}: holds {_MOST_RUNS} runs named {stem}; remove some, or give a directory with --out")


def _try_writing(directory: Path) -> None:
    try:
        with tempfile.TemporaryFile(dir=directory) as file:
            file.write(b"\0" * 4096)
    except OSError as error:
        raise OutputError(f"{directory}: cannot be written to: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    return (isinstance(error, OSError) and error.strerror) or str(error)
