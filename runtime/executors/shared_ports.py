# SPDX-License-Identifier: Apache-2.0
"""Where records of another process enter a loop: mapped files of the runtime directory, one writer each.

A port does not wait for its writer. It looks for the file again from time to time until it is there, and then keeps it:
a writer that starts anew carries the file on.
"""

from __future__ import annotations

from pathlib import Path

from runtime.executors.shared_memory import SharedMemoryError, SharedReader, SharedWriter
from runtime.records import Record

LATEST_CELLS, EVENT_CELLS = 8, 64
LOOK_AGAIN_NS = 100_000_000


def shared_file(directory: Path, topic: str) -> Path:
    """The file of a topic."""
    return directory / topic.strip("/").replace("/", ".")


def latest_writer(directory: Path, record: Record) -> SharedWriter:
    """The far end of a `LatestPort`."""
    return SharedWriter(shared_file(directory, record.topic), record, LATEST_CELLS)


def event_writer(directory: Path, record: Record) -> SharedWriter:
    """The far end of an `EventPort`."""
    return SharedWriter(shared_file(directory, record.topic), record, EVENT_CELLS)


class _SharedPort:
    """A reader that is there as soon as its file is."""

    def __init__(self, directory: Path, cells: int) -> None:
        self._directory, self._cells = directory, cells
        self._reader: SharedReader | None = None
        self._look_again_ns = 0

    def _open(self, record: Record, now_ns: int) -> SharedReader | None:
        if self._reader is None and now_ns >= self._look_again_ns:
            self._look_again_ns = now_ns + LOOK_AGAIN_NS
            try:
                self._reader = SharedReader(shared_file(self._directory, record.topic), record, self._cells)
            except SharedMemoryError:
                return None
        return self._reader


class LatestPort(_SharedPort):
    """Gives the newest record: a measurement, whose predecessors no longer matter."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory, LATEST_CELLS)

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record if there is news."""
        reader = self._open(record, now_ns)
        return reader is not None and reader.latest(record)


class EventPort(_SharedPort):
    """Gives each record in turn, one a read: an event, of which none may be passed over.

    Those that were overwritten before this port came to them are told in the field `lost` of the next, if it has one.
    """

    def __init__(self, directory: Path) -> None:
        super().__init__(directory, EVENT_CELLS)

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record with the next one, if there is one."""
        reader = self._open(record, now_ns)
        if reader is None or not reader.next(record):
            return False
        if hasattr(record, "lost"):
            record.lost = reader.lost
        return True
