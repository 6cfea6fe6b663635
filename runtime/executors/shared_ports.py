# SPDX-License-Identifier: Apache-2.0
"""Where records of another process enter a loop: mapped files of the runtime directory, one writer each.

A port does not wait for its writer. It looks for the file again from time to time until it is there, and then keeps it:
a writer that starts anew carries the file on. While nothing comes the port looks whether another file has taken its
place, as that of a writer with another layout does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import suppress
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


class _SharedPort(ABC):
    """A reader that is there as soon as its file is."""

    def __init__(self, directory: Path, cells: int) -> None:
        self._directory, self._cells = directory, cells
        self._reader: SharedReader | None = None
        self._look_again_ns = 0

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record if there is news."""
        if self._reader is not None and self._take(self._reader, record):
            return True
        if now_ns >= self._look_again_ns:
            self._look_again_ns = now_ns + LOOK_AGAIN_NS
            if self._looked(record):
                assert self._reader is not None
                return self._take(self._reader, record)
        return False

    def _looked(self, record: Record) -> bool:
        """Whether another file is there than before."""
        if self._reader is not None:
            if not self._reader.is_replaced:
                return False
            self._reader.close()
            self._reader = None
        with suppress(SharedMemoryError):
            self._reader = self._opened(record)
        return self._reader is not None

    def _opened(self, record: Record) -> SharedReader:
        return SharedReader(shared_file(self._directory, record.topic), record, self._cells)

    @abstractmethod
    def _take(self, reader: SharedReader, record: Record) -> bool:
        """Fill the record from a file."""


class LatestPort(_SharedPort):
    """Gives the newest record: a measurement, whose predecessors no longer matter."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory, LATEST_CELLS)

    def _take(self, reader: SharedReader, record: Record) -> bool:
        return reader.latest(record)


class EventPort(_SharedPort):
    """Gives each record in turn, one a read: an event, of which none may be passed over.

    Those that were overwritten before this port came to them are told in the field `lost` of the next, if it has one.
    What was said before the first read, by its stamp, was said to another, and is passed over.
    """

    def __init__(self, directory: Path) -> None:
        super().__init__(directory, EVENT_CELLS)
        self._since_ns: int | None = None

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record with the next one, if there is one."""
        if self._since_ns is None:
            self._since_ns = now_ns
        return super().read(record, now_ns)

    def _opened(self, record: Record) -> SharedReader:
        reader, seen = super()._opened(record), record.like()
        reader.pass_over(seen, lambda: bool(seen.stamp_ns < self._since_ns))  # type: ignore[attr-defined]
        return reader

    def _take(self, reader: SharedReader, record: Record) -> bool:
        if not reader.next(record):
            return False
        if hasattr(record, "lost"):
            record.lost = reader.lost
        return True
