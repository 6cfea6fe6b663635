# SPDX-License-Identifier: Apache-2.0
"""Lengths in a damaged file that no memory has are damage, not an exception."""

import struct

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment
from mcap.writer import MCAP0_MAGIC

from runtime.recording.mcap_scan import content, scan

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
