# SPDX-License-Identifier: Apache-2.0
"""Records passed between processes through a mapped file: one writer, any number of readers, none waits for another.

The file is a ring of cells, each with a sequence number and a check sum of the record's bytes. A reader takes either
the newest record (`latest`: a measurement) or each one in turn (`next`: an event), and takes none whose numbers do not
agree, as while it is being overwritten. The oldest cell is left to the writer, which may have been killed within it.
A measurement that cannot be had grows old, which its user sees by its stamp; an event that cannot be had is counted.

    header   layout (u64)  written (u64)
    cell     sequence (u64, from 1)  CRC-32 of sequence and body (u64)  body, padded to 8 bytes
"""

from __future__ import annotations

import fcntl
import hashlib
import mmap
import os
import zlib
from pathlib import Path

from runtime.errors import UgvError
from runtime.records import Record

_WORD = 8
_HEADER_WORDS, _CELL_WORDS = 2, 2
_RETRIES = 8


class SharedMemoryError(UgvError):
    """A mapped file that is another's, or is not there."""


class _Ring:
    """The mapped file, as words and as bytes."""

    def __init__(self, path: Path, record: Record, cells: int, writable: bool) -> None:
        self.path, self.cells, self._body_bytes = path, cells, record.cdr_size
        self._stride = _CELL_WORDS + -(-record.cdr_size // _WORD)
        size = _WORD * (_HEADER_WORDS + cells * self._stride)
        flags = os.O_RDWR | os.O_CREAT if writable else os.O_RDONLY
        try:
            self._descriptor = os.open(path, flags | os.O_CLOEXEC, 0o640)
        except OSError as error:
            raise SharedMemoryError(f"{path}: {error.strerror}") from None
        try:
            self._claim(size) if writable else self._expect(size)
            access = mmap.ACCESS_WRITE if writable else mmap.ACCESS_READ
            self._map = mmap.mmap(self._descriptor, size, access=access)
        except BaseException:
            os.close(self._descriptor)
            raise
        self._bytes = memoryview(self._map)
        self.words = self._bytes.cast("Q")
        layout = f"{record.topic}\n{record.ros_definition()}\n{cells}"
        self.layout = int.from_bytes(hashlib.sha256(layout.encode()).digest()[:_WORD], "little")

    def _claim(self, size: int) -> None:
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SharedMemoryError(f"{self.path} has another writer") from None
        if os.fstat(self._descriptor).st_size != size:
            os.ftruncate(self._descriptor, 0)
            os.ftruncate(self._descriptor, size)

    def _expect(self, size: int) -> None:
        found = os.fstat(self._descriptor).st_size
        if found != size:
            raise SharedMemoryError(f"{self.path} has {found} bytes where {size} belong")

    def cell(self, number: int) -> tuple[int, memoryview]:
        """Index of the first word of a record's cell, and the place of its body; records count from 0."""
        first = _HEADER_WORDS + number % self.cells * self._stride
        begin = _WORD * (first + _CELL_WORDS)
        return first, self._bytes[begin : begin + self._body_bytes]

    def close(self) -> None:
        """Unmap the file, which stays."""
        self.words.release()
        self._bytes.release()
        self._map.close()
        os.close(self._descriptor)


def _sum(sequence: int, body: bytes | memoryview) -> int:
    return zlib.crc32(body, sequence & 0xFFFFFFFF)


class SharedWriter:
    """Writes records of one layout; what an earlier writer left is carried on.

    Args:
        path: of the file, made if it is not there.
        record: whose layout (and topic) the file has.
        cells: one more than the records that readers may fall behind.

    Raises:
        SharedMemoryError: if the file cannot be opened or another process writes to it.
    """

    def __init__(self, path: Path, record: Record, cells: int) -> None:
        self._ring = _Ring(path, record, cells, writable=True)
        words = self._ring.words
        if words[0] != self._ring.layout:
            words[1] = 0
            for number in range(cells):
                words[self._ring.cell(number)[0]] = 0
            words[0] = self._ring.layout

    def write(self, record: Record) -> None:
        """Add a record."""
        words, number = self._ring.words, self._ring.words[1]
        first, place = self._ring.cell(number)
        body = record.to_bytes()
        words[first] = 0
        place[:] = body
        words[first + 1] = _sum(number + 1, body)
        words[first] = number + 1
        words[1] = number + 1

    def close(self) -> None:
        """Let the file go; it stays for its readers."""
        self._ring.close()


class SharedReader:
    """Reads what a `SharedWriter` wrote.

    Args:
        path, record, cells: as the writer's.

    Attributes:
        lost: records that were overwritten before `next` came to them, since start.

    Raises:
        SharedMemoryError: if the file is not there or has another layout.
    """

    def __init__(self, path: Path, record: Record, cells: int) -> None:
        self._ring = _Ring(path, record, cells, writable=False)
        if self._ring.words[0] != self._ring.layout:
            self._ring.close()
            raise SharedMemoryError(f"{path} holds another record than {record.topic}, or one of another layout")
        self._taken = 0
        self.lost = 0

    def latest(self, record: Record) -> bool:
        """Load the newest record; False if there is none that was not taken yet, and `record` then is as it was."""
        for _ in range(_RETRIES):
            written = self._ring.words[1]
            if written == self._taken:
                return False
            if self._take(written - 1, record):
                self._taken = written
                return True
        return False

    def next(self, record: Record) -> bool:
        """Load the oldest record that was not taken yet; False if there is none."""
        for _ in range(_RETRIES):
            written = self._ring.words[1]
            if written < self._taken:
                self._taken = 0
            if written == self._taken:
                return False
            oldest = max(self._taken, written - self._ring.cells + 1)
            if self._take(oldest, record):
                self.lost += oldest - self._taken
                self._taken = oldest + 1
                return True
        return False

    def _take(self, number: int, record: Record) -> bool:
        first, place = self._ring.cell(number)
        sequence, check = self._ring.words[first], self._ring.words[first + 1]
        body = bytes(place)
        if sequence != number + 1 or check != _sum(sequence, body):
            return False
        record.load(body)
        return True

    def close(self) -> None:
        """Unmap the file."""
        self._ring.close()
