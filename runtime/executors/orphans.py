# SPDX-License-Identifier: Apache-2.0
"""No process lives on for long without the one that started it.

The system tells it to end (`end_with_parent`). One that does not heed that is killed by an `OrphanWatch`: this file,
run as a process of its own, which hears by the end of its standard input that the one that started them all is gone.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None, use_errno=True)


def end_with_parent(parent: int) -> None:
    """Have the system end the calling process with SIGTERM when the thread that started it ends, however that comes.

    Args:
        parent: id of the process that it belongs to; if that is gone already, the calling process ends at once.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a handler of the parent's would be lost with the signal, at exec
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


class OrphanWatch:
    """Lives on when this process is killed, and then kills what it has started and what does not end by itself.

    Args:
        within_s: time to end by themselves.
        kept: descriptors that it has open as long as any of them lives.
    """

    def __init__(self, within_s: float, kept: Sequence[int] = ()) -> None:
        self._watch = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, str(within_s)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=kept,
            start_new_session=True,
        )

    def started(self, pid: int) -> None:
        """A process leads a process group of its own; from now on it is watched."""
        self._tell(pid)

    def ended(self, pid: int) -> None:
        """A process is watched no more."""
        self._tell(-pid)

    def _tell(self, number: int) -> None:
        assert self._watch.stdin is not None
        with suppress(BrokenPipeError):  # the watch was killed: the system still tells them to end
            os.write(self._watch.stdin.fileno(), b"%d\n" % number)

    def close(self) -> None:
        """End the watch; those still watched are left alone."""
        self._watch.kill()
        self._watch.communicate()


def _watch(within_s: float) -> None:
    handles: dict[int, int] = {}
    for line in sys.stdin:
        number = int(line)
        if number > 0:
            with suppress(ProcessLookupError):
                handles[number] = os.pidfd_open(number)
        elif -number in handles:
            os.close(handles.pop(-number))
    deadline = time.monotonic() + within_s
    for pid, handle in handles.items():
        if not select.select([handle], [], [], max(0.0, deadline - time.monotonic()))[0]:
            with suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            select.select([handle], [], [])


if __name__ == "__main__":
    _watch(float(sys.argv[1]))
