# SPDX-License-Identifier: Apache-2.0
"""The recorder's process in virtual time: the bags are real, and so are the files."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from runtime.executors.clocks import ClockReading
from runtime.recording.bag import REALTIME
from runtime.recording.bags import Bags
from runtime.recording.recorder_status import RecorderStatus
from runtime.recording.setup import RecordingSetup

STATUS_EVERY_NS = 1_000_000_000
WRITTEN_AT_ONCE = replace(REALTIME, sync_ns=0)
"""As on the robot; power is not cut here."""


class VirtualRecorder:
    """Writes what comes.

    Args:
        directory: for the bags.
        setup: what is recorded.
        take: gives the next datagram, None if none waits.
        clocks: reads the clocks.
        previous: name of the bag of the recorder before this one.

    Attributes:
        status: of the recorder.
        told: what it last said of itself.
    """

    def __init__(
        self,
        directory: Path,
        setup: RecordingSetup,
        take: Callable[[], bytes | None],
        clocks: Callable[[], ClockReading],
        previous: str = "",
    ) -> None:
        self.status = RecorderStatus()
        self._bags = Bags(directory, setup, self.status, lambda _: None, WRITTEN_AT_ONCE, previous, clocks)
        self._take, self._clocks = take, clocks
        self._flush_ns = 0
        self._tell()

    def step(self, now_ns: int) -> None:
        """Write what has come."""
        while (datagram := self._take()) is not None:
            self._bags.write(datagram)
            self._bags.tend()
            self._flush_ns = now_ns + WRITTEN_AT_ONCE.chunk_span_ns
        if now_ns >= self._flush_ns:
            self._bags.flush()
            self._bags.tend()
        told = self.told
        if now_ns >= told.updated_ns + STATUS_EVERY_NS or (told.recording, told.error) != (
            self.status.recording,
            self.status.error,
        ):
            self._tell()

    def _tell(self) -> None:
        self.told = replace(self.status, updated_ns=self._clocks().monotonic_ns)

    def close(self) -> None:
        """End as a process that was told to."""
        self.step(self._clocks().monotonic_ns)
        self._bags.close()

    def kill(self) -> None:
        """End as a process that was killed: the file keeps what the system was given of it, and no more."""
        log = Path(self.status.recording)
        size = log.stat().st_size if self.status.recording else 0
        self._bags.close()
        if size:
            os.truncate(log, size)
            (log.parent / "metadata.yaml").unlink()
