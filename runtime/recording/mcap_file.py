# SPDX-License-Identifier: Apache-2.0
"""An MCAP file, appended to in whole chunks.

The records come from the `mcap` library, except the two that are written thousands of times a second, message and
chunk, which are assembled by struct. A chunk and its indexes reach the file in one write, and a write that fails is
undone, so the file always ends with a whole chunk.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment as AttachmentRecord
from mcap.records import (
    AttachmentIndex,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.records import Channel as ChannelRecord
from mcap.writer import MCAP0_MAGIC

from runtime.records import CDR_LITTLE_ENDIAN

_MESSAGE = struct.Struct("<BQHIQQ")
_CDR_MESSAGE = struct.Struct(f"<BQHIQQ{len(CDR_LITTLE_ENDIAN)}s")
_MESSAGE_FIELDS = _MESSAGE.size - 9
_CDR_FIELDS = _CDR_MESSAGE.size - 9
_CHUNK = struct.Struct("<BQQQQI")
_INDEX = struct.Struct("<BQHI")
_FOOTER = struct.Struct("<BQQQ")
_INDEX_IN_MEMORY_BYTES = 1 << 20


class Output(Protocol):
    """Where the bytes go."""

    def write(self, data: bytes, /) -> int | None:
        """Append; may write less than asked for."""

    def truncate(self, size: int, /) -> int:
        """Cut to a size."""

    def seek(self, offset: int, /) -> int:
        """Move to a position."""


def serialised(record: McapRecord) -> bytes:
    """The bytes of one record."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class McapFile:
    """Writes an MCAP file of profile ros2.

    Args:
        output: unbuffered.
        compression: "zstd", or "" for none.
        level: of the compression.
        directory: for a nameless file with the index of the chunks, once that is large; None for the system's own.

    Attributes:
        message_counts: messages by channel, in the chunks written so far.
        start_ns, end_ns: log times of the earliest and the latest message.
        open_bytes: size of the open chunk so far.
    """

    def __init__(
        self, output: Output, compression: str = "zstd", level: int = 1, directory: Path | None = None
    ) -> None:
        self._output, self._compression = output, compression
        self._compress: Callable[[bytes], bytes] | None = None
        if compression == "zstd":
            self._compress = zstandard.ZstdCompressor(level=level, write_content_size=True).compress
        self._position = 0
        self._schemas: list[Schema] = []
        self._channels: list[ChannelRecord] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        place = None if directory is None else str(directory)
        self._chunks = SpooledTemporaryFile(_INDEX_IN_MEMORY_BYTES, dir=place)  # noqa: SIM115 # closed by finish()
        self._chunk_count = 0
        self._indices: list[list[int]] = [[]]
        self.message_counts: list[int] = [0]
        self.start_ns, self.end_ns = 0, 0
        self._parts: list[bytes | memoryview] = []
        self.open_bytes = 0
        self._chunk_start_ns, self._chunk_end_ns = 0, 0
        self._append(MCAP0_MAGIC + serialised(Header("ros2", "ugv")))

    def _append(self, data: bytes) -> None:
        """Write all of it or nothing."""
        view, written = memoryview(data), 0
        try:
            while written < len(view):
                written += self._output.write(view[written:]) or 0  # type: ignore[arg-type]
        except OSError:
            self._output.seek(self._position)
            self._output.truncate(self._position)
            raise
        self._position += written

    def add_schema(self, name: str, text: str) -> int:
        """Declare a message type; returns its number."""
        schema = Schema(id=len(self._schemas) + 1, data=text.encode(), encoding="ros2msg", name=name)
        self._append(serialised(schema))
        self._schemas.append(schema)
        return schema.id

    def add_channel(self, topic: str, schema: int, metadata: dict[str, str]) -> int:
        """Declare a topic; returns its number."""
        channel = ChannelRecord(len(self._channels) + 1, topic, "cdr", metadata, schema)
        self._append(serialised(channel))
        self._channels.append(channel)
        self._indices.append([])
        self.message_counts.append(0)
        return int(channel.id)

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Append a named file."""
        record = serialised(AttachmentRecord(create_time=0, log_time=0, name=name, media_type=media_type, data=data))
        self._attachments.append(AttachmentIndex(self._position, len(record), 0, 0, len(data), name, media_type))
        self._append(record)

    def add_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Append named text entries."""
        record = serialised(Metadata(name=name, metadata=entries))
        index = MetadataIndex(self._position, len(record), name)
        self._append(record)
        self._metadata.append(index)

    def add_body(self, channel: int, sequence: int, time_ns: int, body: bytes | memoryview) -> None:
        """Add a message given by its CDR body."""
        length = _CDR_FIELDS + len(body)
        self._parts.append(
            _CDR_MESSAGE.pack(5, length, channel, sequence & 0xFFFFFFFF, time_ns, time_ns, CDR_LITTLE_ENDIAN)
        )
        self._parts.append(body)
        self._index(channel, time_ns, length)

    def add_message(self, channel: int, sequence: int, time_ns: int, payload: bytes | memoryview) -> None:
        """Add a message given by its whole payload."""
        length = _MESSAGE_FIELDS + len(payload)
        self._parts.append(_MESSAGE.pack(5, length, channel, sequence & 0xFFFFFFFF, time_ns, time_ns))
        self._parts.append(payload)
        self._index(channel, time_ns, length)

    def _index(self, channel: int, time_ns: int, length: int) -> None:
        self._indices[channel] += (time_ns, self.open_bytes)
        if not self.open_bytes:
            self._chunk_start_ns = self._chunk_end_ns = time_ns
        elif time_ns > self._chunk_end_ns:
            self._chunk_end_ns = time_ns
        elif time_ns < self._chunk_start_ns:
            self._chunk_start_ns = time_ns
        self.open_bytes += length + 9

    @property
    def open_span_ns(self) -> int:
        """Time from the first to the last message of the open chunk."""
        return self._chunk_end_ns - self._chunk_start_ns

    def close_chunk(self) -> None:
        """Write the open chunk and its indexes.

        Raises:
            OSError: if it cannot be written; the file then ends where it ended before.
        """
        if not self._parts:
            return
        raw = b"".join(self._parts)
        self._parts.clear()
        self.open_bytes = 0
        data = raw if self._compress is None else self._compress(raw)
        name = self._compression.encode()
        head = _CHUNK.pack(
            6, 40 + len(name) + len(data), self._chunk_start_ns, self._chunk_end_ns, len(raw), zlib.crc32(raw)
        )
        parts = [head, struct.pack("<I", len(name)), name, struct.pack("<Q", len(data)), data]
        chunk_length = sum(map(len, parts))
        position = self._position + chunk_length
        offsets, counted = {}, []
        for channel, entries in enumerate(self._indices):
            if entries:
                offsets[channel] = position
                body = struct.pack(f"<{len(entries)}Q", *entries)
                parts += (_INDEX.pack(7, 6 + len(body), channel, len(body)), body)
                position += _INDEX.size + len(body)
                counted.append((channel, len(entries) // 2))
                entries.clear()
        start = self._position
        self._append(b"".join(parts))
        self.start_ns = min(self.start_ns, self._chunk_start_ns) if self._chunk_count else self._chunk_start_ns
        self.end_ns = max(self.end_ns, self._chunk_end_ns) if self._chunk_count else self._chunk_end_ns
        for channel, number in counted:
            self.message_counts[channel] += number
        index = ChunkIndex(
            message_start_time=self._chunk_start_ns,
            message_end_time=self._chunk_end_ns,
            chunk_start_offset=start,
            chunk_length=chunk_length,
            message_index_offsets=offsets,
            message_index_length=position - start - chunk_length,
            compression=self._compression,
            compressed_size=len(data),
            uncompressed_size=len(raw),
        )
        self._chunks.write(serialised(index))
        self._chunk_count += 1

    def finish(self) -> None:
        """Close the open chunk and write the summary; the output stays open.

        Raises:
            OSError: if it cannot be written; the file then ends with its last chunk.
        """
        self.close_chunk()
        end = self._position
        try:
            self._write_summary()
        except OSError:
            self._position = self._output.seek(end)
            self._output.truncate(end)
            raise
        self._chunks.close()

    def _write_summary(self) -> None:
        self._append(serialised(DataEnd(0)))
        start, checksum, offsets = self._position, 0, b""
        for opcode, pieces in self._summary():
            begin = self._position
            for piece in pieces:
                self._append(piece)
                checksum = zlib.crc32(piece, checksum)
            if self._position > begin:
                offsets += serialised(SummaryOffset(opcode, begin, self._position - begin))
        offset_start = self._position
        head = _FOOTER.pack(Opcode.FOOTER, 20, start, offset_start)
        checksum = zlib.crc32(head, zlib.crc32(offsets, checksum))
        footer = serialised(Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=checksum))
        self._append(offsets + footer + MCAP0_MAGIC)

    def _summary(self) -> Iterator[tuple[Opcode, Iterable[bytes]]]:
        """The groups of records in the summary; the index of the chunks, which may be long, in pieces."""
        self._chunks.seek(0)
        yield Opcode.SCHEMA, map(serialised, self._schemas)
        yield Opcode.CHANNEL, map(serialised, self._channels)
        yield Opcode.STATISTICS, [serialised(self._statistics())]
        yield Opcode.CHUNK_INDEX, iter(partial(self._chunks.read, _INDEX_IN_MEMORY_BYTES), b"")
        yield Opcode.ATTACHMENT_INDEX, map(serialised, self._attachments)
        yield Opcode.METADATA_INDEX, map(serialised, self._metadata)

    def _statistics(self) -> Statistics:
        counts = {channel: number for channel, number in enumerate(self.message_counts) if number}
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=self._chunk_count,
            message_count=sum(counts.values()),
            message_end_time=self.end_ns,
            message_start_time=self.start_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def open_output(path: Path) -> tuple[Output, int]:
    """Create a file for unbuffered writing; returns it and its descriptor."""
    stream = open(path, "xb", buffering=0)  # noqa: SIM115
    return stream, stream.fileno()


def reserve_space(directory: Path, size: int) -> int | None:
    """Hold back room on the disk, so that a log can still be closed when the disk is full.

    Returns a descriptor of a file without a name; closing it gives the room back. None if the directory offers no such
    room.
    """
    path = directory / f".reserve-{os.getpid()}"
    descriptor = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    os.unlink(path)
    try:
        os.posix_fallocate(descriptor, 0, size)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor
