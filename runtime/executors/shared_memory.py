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
import sys
import zlib
from collections.abc import Callable
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
        self._size = _WORD * (_HEADER_WORDS + cells * self._stride)
        layout = f"{record.topic}\n{record.ros_definition()}\n{cells}"
        self.layout = int.from_bytes(hashlib.sha256(layout.encode()).digest()[:_WORD], "little")
        self._descriptor = self._claimed() if writable else _opened(path, os.O_RDONLY)
        try:
            self._expect()
            access = mmap.ACCESS_WRITE if writable else mmap.ACCESS_READ
            self._map = mmap.mmap(self._descriptor, self._size, access=access)
        except BaseException:
            os.close(self._descriptor)
            raise
        self._bytes = memoryview(self._map)
        self.words = self._bytes.cast("Q")

    def _claimed(self) -> int:
        """The file to write to: the one that is there, or one in its place if that has another layout.

        Readers still have that one mapped, and must find it as long as it was.
        """
        descriptor = _locked(self.path)
        found = os.pread(descriptor, _WORD, 0), os.fstat(descriptor).st_size
        if found == (self._header, self._size):
            return descriptor
        try:
            return self._put_in_place()
        finally:
            os.close(descriptor)

    def _put_in_place(self) -> int:
        new = self.path.with_name(f"{self.path.name}.new")
        new.unlink(missing_ok=True)
        made = _locked(new)
        try:
            os.ftruncate(made, self._size)
            os.pwrite(made, self._header, 0)
            new.replace(self.path)
        except BaseException:
            os.close(made)
            raise
        return made

    @property
    def _header(self) -> bytes:
        return self.layout.to_bytes(_WORD, sys.byteorder)

    def _expect(self) -> None:
        found = os.fstat(self._descriptor).st_size
        if found != self._size:
            raise SharedMemoryError(f"{self.path} has {found} bytes where {self._size} belong")

    @property
    def is_replaced(self) -> bool:
        """Whether another file is there now."""
        try:
            return os.stat(self.path).st_ino != os.fstat(self._descriptor).st_ino
        except FileNotFoundError:
            return True

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


def _opened(path: Path, flags: int) -> int:
    try:
        return os.open(path, flags | os.O_CLOEXEC, 0o640)
    except OSError as error:
        raise SharedMemoryError(f"{path}: {error.strerror}") from None


def _locked(path: Path) -> int:
    """A file of one writer alone, made if it is not there."""
    descriptor = _opened(path, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise SharedMemoryError(f"{path} has another writer") from None
    return descriptor


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
        lost: records that came after the reader, and were overwritten before `next` got to them.

    Raises:
        SharedMemoryError: if the file is not there or has another layout.
    """

    def __init__(self, path: Path, record: Record, cells: int) -> None:
        self._ring = _Ring(path, record, cells, writable=False)
        if self._ring.words[0] != self._ring.layout:
            self._ring.close()
            raise SharedMemoryError(f"{path} holds another record than {record.topic}, or one of another layout")
        self._taken = max(0, self._ring.words[1] - cells + 1)
        self.lost = 0

    @property
    def is_replaced(self) -> bool:
        """Whether the writer has begun another file since, of another layout."""
        return self._ring.is_replaced

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

    def pass_over(self, record: Record, is_past: Callable[[], bool]) -> None:
        """Let `next` begin after the records, loaded into this one each, that are past."""
        for number in range(self._taken, self._ring.words[1]):
            if self._take(number, record) and not is_past():
                return
            self._taken = number + 1

    def next(self, record: Record) -> bool:
        """Load the oldest record that was not taken yet; False if there is none."""
        for _ in range(_RETRIES):
            written = self._ring.words[1]
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
