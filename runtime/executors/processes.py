# SPDX-License-Identifier: Apache-2.0
"""Processes that belong together: started in order, none outlives the one that started them, all stopped in order."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from types import TracebackType

from runtime.errors import UgvError
from runtime.executors.orphans import OrphanWatch, end_with_parent
from runtime.executors.resources import Resources, resources_of
from runtime.executors.runtime_directory import held

STOP_WITHIN_S, READY_WITHIN_S = 10.0, 300.0
"""The first start on a machine translates the control loops."""
_LOOK_S = 0.2
_LONGEST_STATE = 256


class ProcessError(UgvError):
    """A process that ended when it should not, or did not come up."""

    exit_code = 1


class Processes:
    """Subprocesses by name, each in a process group of its own. The starting thread must live as long as they do.

    Use as a context manager: leaving it stops them, the last one started first. Should this process be killed, they are
    told to end.

    Args:
        orphaned_for_s: those that have not ended so long after this process was killed are killed too.
        directory: of `runtime_directory`, if they meet in one: it then stays until the last of them has ended.
    """

    def __init__(self, orphaned_for_s: float = STOP_WITHIN_S, directory: Path | None = None) -> None:
        self._orphaned_for_s, self._directory = orphaned_for_s, directory
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._listeners: dict[str, socket.socket] = {}

    def start(self, name: str, command: Sequence[str], piped: bool = False) -> subprocess.Popen[bytes]:
        """Start a process; `piped` gives its standard input and output to the caller."""
        pipe = subprocess.PIPE if piped else None
        self._listeners[name], address = _manager_socket()
        process = subprocess.Popen(
            command,
            stdin=pipe if piped else subprocess.DEVNULL,
            stdout=pipe,
            env={**os.environ, "NOTIFY_SOCKET": address},
            start_new_session=True,
            preexec_fn=partial(end_with_parent, os.getpid()),
        )
        self._watch.started(process.pid)
        self._running[name] = process
        return process

    @property
    def names(self) -> tuple[str, ...]:
        """Of those that were started and not stopped."""
        return tuple(self._running)

    def pid(self, name: str) -> int:
        """Process id of one of them."""
        return self._running[name].pid

    def wait_ready(self, name: str, within_s: float = READY_WITHIN_S) -> None:
        """Wait until a process says that it is ready, as it would say it to systemd.

        Raises:
            ProcessError: if it ends first, or takes too long.
        """
        listener, deadline = self._listeners[name], time.monotonic() + within_s
        listener.settimeout(_LOOK_S)
        while time.monotonic() < deadline:
            with suppress(TimeoutError):
                if listener.recv(_LONGEST_STATE) == b"READY=1":
                    return
            self.check()
        raise ProcessError(f"the process {name} is not ready after {within_s:g} s")

    def told(self, name: str) -> list[str]:
        """What a process has told its service manager, which is this one, since the last look."""
        listener, words = self._listeners[name], []
        listener.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                words.append(listener.recv(_LONGEST_STATE).decode(errors="replace"))
        return words

    @property
    def ended(self) -> dict[str, int]:
        """Names and return codes of those that have ended by themselves."""
        codes = {name: process.poll() for name, process in self._running.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def resources(self) -> dict[str, Resources]:
        """What each of those that run holds of the system."""
        held = {name: resources_of(process.pid) for name, process in self._running.items()}
        return {name: one for name, one in held.items() if one is not None}

    def check(self) -> None:
        """Look after them.

        Raises:
            ProcessError: if one has ended.
        """
        for name, code in self.ended.items():
            raise ProcessError(f"the process {name} {how_it_ended(code)}")

    def terminate(self, name: str) -> None:
        """Tell one to end, and do not wait for it."""
        self._running[name].terminate()

    def stop(self, name: str, within_s: float = STOP_WITHIN_S) -> int:
        """End one with SIGTERM, or with SIGKILL if that takes too long; returns its code."""
        process = self._running.pop(name)
        if process.poll() is None:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(within_s)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        self._listeners.pop(name).close()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
        code = process.wait()
        self._watch.ended(process.pid)
        return code

    def __enter__(self) -> Processes:
        with ExitStack() as stack:
            kept = () if self._directory is None else (stack.enter_context(held(self._directory)),)
            self._watch = OrphanWatch(self._orphaned_for_s, kept)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in reversed(self.names):
            self.stop(name)
        self._watch.close()


def _manager_socket() -> tuple[socket.socket, str]:
    """A socket that hears what a process would tell systemd, and its address."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind("")  # the kernel chooses an abstract address
    address: bytes = listener.getsockname()
    return listener, "@" + address[1:].decode()


def how_it_ended(code: int) -> str:
    """A return code in words."""
    return f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
