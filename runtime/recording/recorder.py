# SPDX-License-Identifier: Apache-2.0
"""The recorder's near end: hands each tick's datagram to a process of its own."""

from __future__ import annotations

import json
import os
import pickle
import socket
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any

from runtime.recording.bag import LOCKSTEP, BagOptions
from runtime.recording.errors import RecordingError
from runtime.recording.setup import RecordingSetup

_SEND_BUFFER_BYTES = 4 << 20
_ROOT = Path(__file__).resolve().parents[2]


class RecorderProcess:
    """Writes the log of a run in another process.

    The recorder outlives the death of this process: it sees the end of the stream and closes the log.

    Args:
        directory: the run directory.
        setup: what is to be recorded.
        options: how.
        drop: when the recorder is behind, drop and count the datagram (real time) instead of waiting (lockstep).

    Attributes:
        dropped: datagrams dropped so far.
        path: of the log.

    Raises:
        RecordingError: if the recorder cannot write in the directory.
    """

    def __init__(
        self, directory: Path, setup: RecordingSetup, options: BagOptions = LOCKSTEP, drop: bool = False
    ) -> None:
        self.dropped = 0
        self.path = directory / f"{directory.resolve().name}_0.mcap"
        self._flags = socket.MSG_NOSIGNAL | (socket.MSG_DONTWAIT if drop else 0)
        self._failed = ""
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        self._process: subprocess.Popen[bytes] | None = None
        with theirs:
            environment = dict(os.environ)
            environment["PYTHONPATH"] = os.pathsep.join(
                part for part in (str(_ROOT), environment.get("PYTHONPATH", "")) if part
            )
            self._process = subprocess.Popen(
                [sys.executable, "-m", "runtime.recording.recorder_process", str(theirs.fileno())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[theirs.fileno()],
                env=environment,
                start_new_session=True,
            )
        assert self._process.stdin is not None
        try:
            with self._process.stdin as stdin:
                pickle.dump((directory.resolve(), setup, options), stdin)
        except BrokenPipeError:
            raise self._failure() from None
        if not self._answer().get("ready"):
            raise self._failure()

    @property
    def pid(self) -> int:
        """Process id of the recorder."""
        assert self._process is not None
        return self._process.pid

    def write(self, datagram: bytes) -> None:
        """Hand over one tick.

        Raises:
            RecordingError: if the recorder has ended; the sentence says why.
        """
        try:
            self._socket.send(datagram, self._flags)
        except BlockingIOError:
            self.dropped += 1
        except OSError:
            raise self._failure() from None

    def close(self) -> None:
        """Wait until the log is closed. Calling it again does nothing.

        Raises:
            RecordingError: if the log could not be completed.
        """
        if self._process is None:
            return
        self._socket.close()
        if not self._answer().get("closed"):
            raise self._failure()
        self._reap()

    def _answer(self) -> dict[str, Any]:
        """The recorder's next line, empty if it ended without one."""
        assert self._process is not None
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        answer: dict[str, Any] = json.loads(line) if line.endswith(b"\n") else {}
        self._failed = answer.get("error", self._failed)
        return answer

    def _failure(self) -> RecordingError:
        """Why the recorder ended, as an exception."""
        if self._process is not None:
            while self._answer():
                pass
            code = self._reap()
            if not self._failed:
                how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
                self._failed = f"the recorder of {self.path} {how}; the log holds what it had written"
        return RecordingError(self._failed)

    def _reap(self) -> int:
        assert self._process is not None
        assert self._process.stdout is not None
        self._socket.close()
        self._process.stdout.close()
        code = self._process.wait()
        self._process = None
        return code

    def __enter__(self) -> RecorderProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
