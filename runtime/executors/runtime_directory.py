# SPDX-License-Identifier: Apache-2.0
"""A runtime directory for one run on a workstation, in memory where that is possible; none is left behind.

It goes with the process that made it. Should that one be killed, its heir removes the directory: this file, run as a
process of its own, which waits until nobody holds the directory any more. Should both be killed, the next run removes
it.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PREFIX, _GONE, _LOCK = "ugv-run-", "ugv-gone-", "lock"


def _base() -> Path:
    return Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else Path(tempfile.gettempdir())


@contextmanager
def runtime_directory() -> Iterator[Path]:
    """Make one, and remove those whose makers are gone."""
    for left in _base().glob(f"{_PREFIX}*"):
        _remove_if_orphaned(left, fcntl.LOCK_EX | fcntl.LOCK_NB)
    directory = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=_base()))
    with held(directory), _heir(directory):
        try:
            yield directory
        finally:
            _remove(directory)


@contextmanager
def held(directory: Path) -> Iterator[int]:
    """Keep a runtime directory, and give a descriptor: it stays as long as that is open, here or in another process."""
    lock = os.open(directory / _LOCK, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_SH)
        yield lock
    finally:
        os.close(lock)


@contextmanager
def _heir(directory: Path) -> Iterator[None]:
    """A process that removes the directory when this one is killed; of a session of its own, so that no key ends it."""
    with subprocess.Popen(
        [sys.executable, "-I", "-S", __file__, str(directory)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    ) as heir:
        try:
            yield
        finally:
            heir.kill()


def _remove_if_orphaned(directory: Path, lock_request: int) -> None:
    """Remove a runtime directory if this request for its lock (see `fcntl.flock`) is granted: nobody holds it."""
    try:
        lock = os.open(directory / _LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return
    try:
        fcntl.flock(lock, lock_request)
        _remove(directory)
    except BlockingIOError:
        return
    finally:
        os.close(lock)


def _remove(directory: Path) -> None:
    """Remove a directory; under another name, so that processes that still run make no new files in it meanwhile."""
    gone = directory.with_name(directory.name.replace(_PREFIX, _GONE, 1))
    with suppress(FileNotFoundError):
        directory.rename(gone)
    shutil.rmtree(gone, ignore_errors=True)


if __name__ == "__main__":
    _remove_if_orphaned(Path(sys.argv[1]), fcntl.LOCK_EX)
