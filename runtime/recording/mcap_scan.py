# SPDX-License-Identifier: Apache-2.0
"""Reads an MCAP file from front to back as far as it is whole, whether or not it was closed."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_MESSAGE = struct.Struct("<HIQQ")
_LATEST_NS = 2**63 - 1
"""The file has 64 bits without a sign for a time, our clocks and arrays have one with a sign."""


class RawMessage(NamedTuple):
    """One message: its channel in the file, its sequence number, its log time and its payload."""

    channel: int
    sequence: int
    log_ns: int
    payload: memoryview


class ChunkPlace(NamedTuple):
    """Where a chunk lies in the file, and what its header says."""

    start: int
    end: int
    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str


@dataclass
class Scan:
    """What a file holds.

    Attributes:
        data: the file.
        schemas, channels: by number.
        attachments, metadata: by name.
        chunks: the whole ones.
        closed: whether the file ends as it should.
        damage: a phrase for each thing that is damaged.
    """

    data: memoryview
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    media_types: dict[str, str] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    closed: bool = False
    damage: list[str] = field(default_factory=list)


def is_mcap(data: memoryview) -> bool:
    """Whether a file, or what is left of it, begins as an MCAP file does."""
    head = bytes(data[: len(MCAP0_MAGIC)])
    return bool(head) and MCAP0_MAGIC.startswith(head)


def scan(data: memoryview) -> Scan:
    """Find every whole record outside and every declaration inside the chunks."""
    found = Scan(data)
    for opcode, body in _records(found, len(MCAP0_MAGIC)):
        if opcode == Opcode.CHUNK:
            if body.stop - body.start >= _CHUNK.size:
                _note_chunk(found, body)
        elif opcode == Opcode.DATA_END:
            found.closed = bytes(data[-len(MCAP0_MAGIC) :]) == MCAP0_MAGIC and len(data) > body.stop + 16
            break
        else:
            _declare(found, opcode, data[body])
    return found


def _records(found: Scan, position: int) -> Iterator[tuple[int, slice]]:
    size = len(found.data)
    while position + _RECORD.size <= size:
        opcode, length = _RECORD.unpack_from(found.data, position)
        position += _RECORD.size
        if position + length > size:
            return
        yield opcode, slice(position, position + length)
        position += length


def _note_chunk(found: Scan, body: slice) -> None:
    start_ns, end_ns, size, crc, name_length = _CHUNK.unpack_from(found.data, body.start)
    begin = body.start + _CHUNK.size
    compression = bytes(found.data[begin : begin + name_length]).decode(errors="replace")
    begin += name_length + 8
    times = _time(found, start_ns), _time(found, end_ns)
    found.chunks.append(ChunkPlace(begin, body.stop, *times, size, crc, compression))


def _declare(found: Scan, opcode: int, body: memoryview) -> None:
    try:
        _take_up(found, opcode, body)
    except (struct.error, UnicodeDecodeError, OverflowError, McapError):
        _note(found, "a declaration at its beginning is not what the format asks for")


def _take_up(found: Scan, opcode: int, body: memoryview) -> None:
    stream = ReadDataStream(BytesIO(bytes(body)))
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        found.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        found.channels[channel.id] = channel
    elif opcode == Opcode.ATTACHMENT:
        attachment = Attachment.read(stream)
        found.attachments[attachment.name] = attachment.data
        found.media_types[attachment.name] = attachment.media_type
        if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
            _note(found, f"attachment {attachment.name} does not match its checksum")
    elif opcode == Opcode.METADATA:
        metadata = Metadata.read(stream)
        found.metadata[metadata.name] = metadata.metadata


def content(found: Scan, place: ChunkPlace) -> memoryview:
    """The records of a chunk; empty if it cannot be unpacked. Damage is noted, not raised."""
    data = found.data[place.start : place.end]
    where = f"the chunk from {place.start_ns / 1e9:.3f} to {place.end_ns / 1e9:.3f} s"
    try:
        if place.compression == "zstd":
            raw: bytes | memoryview = zstandard.ZstdDecompressor().decompress(data, max_output_size=place.size)
        elif place.compression == "lz4":
            raw = lz4.frame.decompress(data)
        else:
            raw = data
    except (zstandard.ZstdError, RuntimeError, MemoryError, OverflowError):
        _note(found, f"{where} cannot be unpacked")
        return memoryview(b"")
    if place.crc and zlib.crc32(raw) != place.crc:
        _note(found, f"{where} does not match its checksum")
    return memoryview(raw)


def _time(found: Scan, time_ns: int) -> int:
    """A time of a record; the latest that our clocks can show for one that is beyond."""
    if time_ns > _LATEST_NS:
        _note(found, "a time is beyond what 63 bits of nanoseconds hold")
        return _LATEST_NS
    return time_ns


def _note(found: Scan, phrase: str) -> None:
    if phrase not in found.damage:
        found.damage.append(phrase)


def messages(found: Scan, chunk: memoryview) -> Iterator[RawMessage]:
    """The messages of a chunk's records; declarations met on the way are taken up."""
    position, size = 0, len(chunk)
    head, message = _RECORD.unpack_from, _MESSAGE.unpack_from
    while position + _RECORD.size <= size:
        opcode, length = head(chunk, position)
        position += _RECORD.size
        if position + length > size:
            return
        if opcode == 5 and length >= _MESSAGE.size:
            channel, sequence, log_ns, _ = message(chunk, position)
            yield RawMessage(
                channel, sequence, _time(found, log_ns), chunk[position + _MESSAGE.size : position + length]
            )
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _declare(found, opcode, chunk[position : position + length])
        position += length
