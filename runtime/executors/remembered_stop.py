# SPDX-License-Identifier: Apache-2.0
"""An emergency stop outlives the control process that was given it: a reset ends it, or a new start of the computer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from runtime.executors.shared_memory import SharedMemoryError, SharedReader
from runtime.executors.shared_ports import LATEST_CELLS, EventPort, shared_file
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import OperatorEvent, OperatorRequest, Request
from runtime.tasks import Loop

KEPT_AS = "emergency_stop"
"""The file that is in the runtime directory while the stop is latched."""


class RememberedStop:
    """Input port of the operator's events, of which the first may be a stop that was asked of an earlier process.

    That is one that it had taken up, or one that came when it was away: the link keeps the last stop or reset apart.

    Args:
        directory: runtime directory, shared with that process and with the link.
        loops: one of which writes what is made of the events, tick by tick.
        say: told in one sentence that the stop cannot be kept.
    """

    def __init__(self, directory: Path, loops: Sequence[Loop], say: Callable[[str], None]) -> None:
        (self._request,) = (each for loop in loops for each in loop.writes if isinstance(each, OperatorRequest))
        self._events, self._say = EventPort(directory), say
        self._directory, self._file = directory, directory / KEPT_AS
        self._kept = self._file.exists()
        self._begun = self._left = False

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the next event."""
        assert isinstance(record, OperatorEvent)
        came = self._events.read(record, now_ns)
        if not self._begun:
            self._begun, self._left = True, self._kept or self._pressed()
        elif not self._left and self._request.emergency_stop != self._kept:
            self._keep()
        if came or not self._left:
            return came
        self._left = False
        record.clear()
        record.stamp_ns, record.request = now_ns, Request.EMERGENCY_STOP
        return True

    def _pressed(self) -> bool:
        """Whether a stop is the last that the link kept; no process may have seen it."""
        event = OperatorEvent(topics.OPERATOR_STOP)
        with suppress(SharedMemoryError):
            reader = SharedReader(shared_file(self._directory, event.topic), event, LATEST_CELLS)
            reader.latest(event)
            reader.close()
        return bool(event.request == Request.EMERGENCY_STOP)

    def _keep(self) -> None:
        self._kept = bool(self._request.emergency_stop)
        try:
            if self._kept:
                self._file.touch()
            else:
                self._file.unlink()
        except OSError as error:
            self._say(f"the emergency stop cannot be kept for a control that is started again: {error.strerror}")
