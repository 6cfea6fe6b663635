# SPDX-License-Identifier: Apache-2.0
"""One thread of a process is made to stand still while the others go on."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_CONT, _DETACH, _SEIZE, _INTERRUPT = 7, 17, 0x4206, 0x4207
"""Requests of ptrace(2)."""
WAIT_FOR_THREADS = 0x40000000
"""Option of waitpid(2): also for threads that are no children."""
_GOES_ON_S = 0.0001
"""A thread that was not asleep gets so far before it is stopped again; else it would not come to its sleep."""
SLEEP = {"x86_64": "230", "aarch64": "115"}[os.uname().machine]
"""Number of clock_nanosleep(2), in which a loop waits for its time."""
WAIT = {"x86_64": "202", "aarch64": "98"}[os.uname().machine]
"""Number of futex(2), in which a thread waits for another."""
_LIBC = ctypes.CDLL(None, use_errno=True)
_LIBC.ptrace.argtypes = (ctypes.c_long, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)


def thread_of(process: int, priority: int) -> int:
    """The one thread of a process that has a priority under SCHED_FIFO.

    Raises:
        ValueError: if there is none, or more than one.
    """
    threads = [int(task.name) for task in Path(f"/proc/{process}/task").iterdir()]
    (found,) = [thread for thread in threads if os.sched_getparam(thread).sched_priority == priority]
    return found


@contextmanager
def held(thread: int, asleep_in: str = SLEEP) -> Iterator[None]:
    """A thread stands still, stopped in its sleep, where it holds nothing that others want.

    Args:
        thread: of any process.
        asleep_in: number of the system call in which it sleeps.

    Raises:
        OSError: if that is not allowed.
    """
    _ptrace(_SEIZE, thread)
    try:
        while True:
            _ptrace(_INTERRUPT, thread)
            os.waitpid(thread, WAIT_FOR_THREADS)
            if Path(f"/proc/{thread}/syscall").read_text().split()[0] == asleep_in:
                break
            _ptrace(_CONT, thread)
            time.sleep(_GOES_ON_S)
        yield
    finally:
        with suppress(ProcessLookupError):  # it may have ended
            _ptrace(_DETACH, thread)


def _ptrace(request: int, thread: int) -> None:
    if _LIBC.ptrace(request, thread, None, None) < 0:
        raise OSError(ctypes.get_errno(), "ptrace, which in a container takes CAP_SYS_PTRACE")
