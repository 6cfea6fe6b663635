# SPDX-License-Identifier: Apache-2.0
"""The recorder in real time: a process that control may outlive and that may outlive control.

One thread takes datagrams off the socket, so that no sender meets a full one while the disk is slow; another writes
them. What both say of themselves is in `recorder.status` of the runtime directory.
"""

from __future__ import annotations

import queue
import signal
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType

from runtime.executors.linux import run_first
from runtime.executors.notify import Notifier
from runtime.executors.tick_stream import RECORDER_SOCKET, TickListener
from runtime.recording.bag import REALTIME
from runtime.recording.bags import Bags
from runtime.recording.errors import RecordingError
from runtime.recording.recorder_status import RecorderStatus, read_status
from runtime.recording.setup import Attachment, RecordingSetup

BACKLOG_BYTES = 64 << 20
"""What may wait for the disk: at 4 MB a second, a quarter of a minute."""
STATUS_EVERY_NS = 1_000_000_000
ALIVE_EVERY_NS = 500_000_000
STUCK_AFTER_NS = 10_000_000_000
"""A write that takes longer is not waited for: the watchdog then ends the process."""
_FLUSH_S = REALTIME.chunk_span_ns / 1e9
_DRAIN_S = 1.0


class Backlog:
    """Datagrams between the thread that receives them and the one that writes them."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._put = self._taken = 0

    @property
    def size(self) -> int:
        """Bytes that wait."""
        return self._put - self._taken

    def put(self, datagram: bytes) -> bool:
        """Let a datagram wait; False if there is no room for it."""
        if self.size + len(datagram) > BACKLOG_BYTES:
            return False
        self._put += len(datagram)
        self._waiting.put(datagram)
        return True

    def end(self) -> None:
        """Nothing more will come."""
        self._waiting.put(None)

    def take(self, timeout_s: float) -> bytes | None:
        """The oldest one; None at the end.

        Raises:
            queue.Empty: if none comes in time.
        """
        datagram = self._waiting.get(timeout=timeout_s)
        self._taken += len(datagram or b"")
        return datagram


class _Writer(threading.Thread):
    """Writes what waits until its end."""

    def __init__(self, backlog: Backlog, bags: Bags) -> None:
        super().__init__(name="writer", daemon=True)
        self._backlog, self._bags = backlog, bags
        self.alive_ns = time.monotonic_ns()

    def run(self) -> None:
        while True:
            try:
                datagram = self._backlog.take(_FLUSH_S)
                if datagram is None:
                    break
                self._bags.write(datagram)
            except queue.Empty:
                self._bags.flush()
            self._bags.tend()
            self.alive_ns = time.monotonic_ns()
        self._bags.close()


def serve(
    setup: RecordingSetup,
    runtime_directory: Path,
    log_directory: Path,
    files: Sequence[Path] = (),
    priority: int = 0,
) -> None:
    """Record until SIGTERM or SIGINT.

    Args:
        setup: of the robot whose ticks come, and of the processes beside it.
        runtime_directory: where the socket and the status file are.
        log_directory: where the bags are made.
        files: that each bag carries, under their own names; such as `terrain.npz`.
        priority: of its threads under SCHED_FIFO, 0 for the normal one. A recorder that has to wait for its turn on a
            busy machine loses what waits with it when it is killed.

    Raises:
        RecordingError: if a file cannot be read, or the writer has ended.
        TickStreamError: if the socket cannot be made.
    """
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    extra = (Attachment(file.name, "application/octet-stream", _content(file)) for file in files)
    setup = replace(setup, attachments=(*setup.attachments, *extra))
    before, status = read_status(runtime_directory), RecorderStatus()
    bags = Bags(log_directory, setup, status, _say, previous="" if before is None else before.bag)
    backlog = Backlog()
    refused = run_first(priority) if priority else ""
    if refused:
        _say(refused)
    writer = _Writer(backlog, bags)
    listener = TickListener(runtime_directory / RECORDER_SOCKET)
    writer.start()
    try:
        _receive(listener, backlog, writer, status, runtime_directory, stop)
    finally:
        listener.close()
        backlog.end()
        writer.join()
        status.recording = ""
        _tell(status, runtime_directory)


def _receive(
    listener: TickListener,
    backlog: Backlog,
    writer: _Writer,
    status: RecorderStatus,
    runtime_directory: Path,
    stop: threading.Event,
) -> None:
    """Take datagrams off the socket until told to stop, then those that are there already."""
    notifier = Notifier()
    notifier.send("READY=1")
    status_ns = alive_ns = 0
    told = ("", "")
    while not stop.is_set():
        datagram = listener.receive(_FLUSH_S)
        if datagram is not None and not backlog.put(datagram):
            status.overflowed += 1
        now_ns = time.monotonic_ns()
        if now_ns >= alive_ns and now_ns - writer.alive_ns < STUCK_AFTER_NS:
            alive_ns = now_ns + ALIVE_EVERY_NS
            notifier.send("WATCHDOG=1")
        if now_ns >= status_ns or told != (status.recording, status.error):
            status_ns, told = now_ns + STATUS_EVERY_NS, (status.recording, status.error)
            status.backlog_bytes = backlog.size
            _tell(status, runtime_directory)
            if not writer.is_alive():
                raise RecordingError("the recorder's writer has ended")
    notifier.send("STOPPING=1")
    deadline_ns = time.monotonic_ns() + int(_DRAIN_S * 1e9)
    while time.monotonic_ns() < deadline_ns and (datagram := listener.receive(0.0)) is not None:
        status.overflowed += not backlog.put(datagram)


def _tell(status: RecorderStatus, directory: Path) -> None:
    """Write the status; where that is refused, recording goes on."""
    status.updated_ns = time.monotonic_ns()
    try:
        status.write(directory)
    except OSError as error:
        if not status.error:
            _say(f"{directory}: the status cannot be written ({(error.strerror or str(error)).lower()})")


def _content(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise RecordingError(f"{file} cannot be read: {(error.strerror or str(error)).lower()}") from None


def _say(sentence: str) -> None:
    print(f"ugv recorder: {sentence}", file=sys.stderr, flush=True)
