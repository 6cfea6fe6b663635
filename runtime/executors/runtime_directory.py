# SPDX-License-Identifier: Apache-2.0
"""A runtime directory for one run on a workstation, in memory where that is possible; none is left behind for good.

It goes with the process that made it. Should that one be killed, the directory is removed by `remove_if_orphaned` in a
process that outlives it, or by the next run.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_PREFIX, _LOCK = "ugv-run-", "lock"


def _base() -> Path:
    return Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else Path(tempfile.gettempdir())


@contextmanager
def runtime_directory() -> Iterator[Path]:
    """Make one, and remove those whose makers are gone."""
    for left in _base().glob(f"{_PREFIX}*"):
        remove_if_orphaned(left)
    with tempfile.TemporaryDirectory(prefix=_PREFIX, dir=_base(), ignore_cleanup_errors=True) as name:
        lock = os.open(Path(name) / _LOCK, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield Path(name)
        finally:
            os.close(lock)


def remove_if_orphaned(directory: Path) -> bool:
    """Remove a runtime directory if the process that made it is gone; true if so."""
    try:
        lock = os.open(directory / _LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(lock)
    shutil.rmtree(directory, ignore_errors=True)
    return True
