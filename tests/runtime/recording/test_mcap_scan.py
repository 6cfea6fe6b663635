# SPDX-License-Identifier: Apache-2.0
"""Lengths in a damaged file that no memory has, and times that no clock shows, are damage, not an exception."""

import struct

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment
from mcap.writer import MCAP0_MAGIC

from runtime.recording.mcap_scan import content, messages, scan

HUGE = (2**40, 2**63, 2**64 - 1)


def file_of(opcode, body):
    return memoryview(bytes(MCAP0_MAGIC) + struct.pack("<BQ", opcode, len(body)) + body)


@pytest.mark.parametrize("length", HUGE)
def test_an_attachment_that_claims_too_much(length):
    builder = RecordBuilder()
    Attachment(create_time=0, data=b"12345678", log_time=0, media_type="x", name="y").write(builder)
    body = bytearray(builder.end()[9:])
    place = bytes(body).index(b"12345678") - 8
    body[place : place + 8] = struct.pack("<Q", length)
    found = scan(file_of(Opcode.ATTACHMENT, bytes(body)))
    assert found.damage


@pytest.mark.parametrize("size", HUGE)
def test_a_chunk_that_claims_too_much(size):
    packed = zstandard.ZstdCompressor(write_content_size=False).compress(b"abc")
    name = b"zstd"
    body = struct.pack("<QQQII", 0, 1, size, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    found = scan(file_of(Opcode.CHUNK, body))
    (place,) = found.chunks
    assert bytes(content(found, place)) in (b"", b"abc")
    assert found.damage or bytes(content(found, place)) == b"abc"


@pytest.mark.parametrize("time_ns", [2**63, 2**64 - 1])
def test_times_beyond_any_clock(time_ns):
    message = struct.pack("<HIQQ", 1, 7, time_ns, time_ns) + b"payload"
    raw = struct.pack("<BQ", Opcode.MESSAGE, len(message)) + message
    body = struct.pack("<QQQII", time_ns, time_ns, len(raw), 0, 0) + struct.pack("<Q", len(raw)) + raw
    found = scan(file_of(Opcode.CHUNK, body))
    (place,) = found.chunks
    (seen,) = messages(found, content(found, place))
    latest = 2**63 - 1
    assert (place.start_ns, place.end_ns, seen.log_ns, seen.sequence) == (latest, latest, latest, 7)
    assert found.damage == ["a time is beyond what 63 bits of nanoseconds hold"]
