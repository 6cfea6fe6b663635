# SPDX-License-Identifier: Apache-2.0
"""Readers get whole records in order or none, whatever the writer is doing, and count what they could not have."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.executors.shared_memory import SharedMemoryError, SharedReader, SharedWriter
from runtime.records import Record, float64_array, int64, uint8

CELLS = 4


class Sample(Record):
    """A number, many times."""

    number = int64()
    copies = float64_array(40)
    last = uint8()


class Other(Record):
    """Of the same size, but not the same."""

    number = int64("ns")
    copies = float64_array(40)
    last = uint8()


def sample(number=0):
    record = Sample("/sample")
    record.number, record.copies, record.last = number, float(number), number % 256
    return record


@pytest.fixture
def path(tmp_path):
    return tmp_path / "sample"


@settings(max_examples=60)
@given(st.lists(st.tuples(st.sampled_from(["write", "next", "latest"]), st.integers(1, 6)), max_size=30))
def test_readers_get_what_a_list_would_give(tmp_path_factory, operations):
    path = tmp_path_factory.mktemp("ring") / "sample"
    writer, seen = SharedWriter(path, sample(), CELLS), sample(-1)
    events, newest = SharedReader(path, sample(), CELLS), SharedReader(path, sample(), CELLS)
    written, taken, lost, latest = 0, 0, 0, 0
    for operation, times in operations:
        for _ in range(times):
            if operation == "write":
                writer.write(sample(written))
                written += 1
            elif operation == "next":
                oldest = max(taken, written - CELLS + 1)
                assert events.next(seen) == (taken < written)
                if taken < written:
                    lost, taken = lost + oldest - taken, oldest + 1
                    assert seen.number == oldest
            else:
                assert newest.latest(seen) == (latest < written)
                latest = written
                assert not written or operation == "write" or seen.number <= written - 1
    assert (events.lost, newest.lost) == (lost, 0)
    for end in (events, newest, writer):
        end.close()


def test_the_newest_is_taken_once(path):
    writer = SharedWriter(path, sample(), CELLS)
    reader, seen = SharedReader(path, sample(), CELLS), sample(-1)
    assert not reader.latest(seen)
    assert seen.number == -1
    for number in range(11):
        writer.write(sample(number))
    assert reader.latest(seen)
    assert seen.to_bytes() == sample(10).to_bytes()
    assert not reader.latest(seen)


@pytest.mark.parametrize("read", ["latest", "next"])
@pytest.mark.parametrize("byte", [0, 1, 8, 15, 16, 100, 16 + 328])
def test_a_cell_whose_numbers_do_not_agree_is_not_taken(path, read, byte):
    writer = SharedWriter(path, sample(), CELLS)
    reader, seen = SharedReader(path, sample(), CELLS), sample(-1)
    writer.write(sample(7))
    content = bytearray(path.read_bytes())
    content[16 + byte] ^= 0x10
    path.write_bytes(content)
    assert not getattr(reader, read)(seen)
    assert seen.number == -1
    writer.write(sample(8))
    assert reader.latest(seen)
    assert seen.number == 8


def test_a_writer_killed_while_writing_leaves_what_it_had_written(path):
    writer = SharedWriter(path, sample(), CELLS)
    reader, seen = SharedReader(path, sample(), CELLS), sample(-1)
    for number in range(CELLS + 2):
        writer.write(sample(number))
    # the next record goes into the oldest cell, and only its beginning has got there
    content = np.fromfile(path, np.uint64)
    cell = 2 + (CELLS + 2) % CELLS * (2 + 42)
    content[cell], content[cell + 2] = 0, 99
    content.tofile(path)
    writer.close()
    got = []
    while reader.next(seen):
        got.append(seen.number)
    assert got == [3, 4, 5]
    assert reader.lost == 3
    again = SharedWriter(path, sample(), CELLS)
    again.write(sample(6))
    assert reader.next(seen)
    assert seen.number == 6


def test_two_writers_are_one_too_many(path):
    writer = SharedWriter(path, sample(), CELLS)
    with pytest.raises(SharedMemoryError, match="sample has another writer"):
        SharedWriter(path, sample(), CELLS)
    writer.close()
    SharedWriter(path, sample(), CELLS).close()


def test_a_file_that_is_not_there_or_holds_something_else_is_refused(path):
    with pytest.raises(SharedMemoryError, match="No such file"):
        SharedReader(path, sample(), CELLS)
    SharedWriter(path, sample(), CELLS).close()
    with pytest.raises(SharedMemoryError, match="bytes where"):
        SharedReader(path, sample(), CELLS + 1)
    with pytest.raises(SharedMemoryError, match="holds another record than /sample, or one of another layout"):
        SharedReader(path, Other("/sample"), CELLS)
    with pytest.raises(SharedMemoryError, match="No such file"):
        SharedWriter(path.parent / "nowhere" / "sample", sample(), CELLS)


def test_a_reader_begins_with_what_is_there_and_misses_nothing_that_was_before_it(path):
    writer = SharedWriter(path, sample(), CELLS)
    for number in range(10):
        writer.write(sample(number))
    reader, seen, got = SharedReader(path, sample(), CELLS), sample(-1), []
    while reader.next(seen):
        got.append(seen.number)
    assert (got, reader.lost) == ([7, 8, 9], 0)


def test_the_file_that_a_reader_has_stays_whole_when_a_writer_of_another_layout_comes(path):
    writer = SharedWriter(path, sample(), CELLS)
    writer.write(sample(3))
    writer.close()
    reader, seen = SharedReader(path, sample(), CELLS), sample(-1)
    assert not reader.is_replaced
    SharedWriter(path, sample(), 1000 * CELLS).close()
    assert reader.is_replaced
    assert reader.latest(seen)
    assert seen.number == 3


def test_a_writer_of_another_layout_begins_anew(path):
    writer = SharedWriter(path, sample(), CELLS)
    writer.write(sample(3))
    writer.close()
    other = SharedWriter(path, Other("/sample"), CELLS)
    reader, seen = SharedReader(path, Other("/sample"), CELLS), Other("/sample")
    assert not reader.latest(seen)
    other.write(Other("/sample"))
    assert reader.latest(seen)


HAMMER = """
import importlib.util, sys
from pathlib import Path
spec = importlib.util.spec_from_file_location("samples", sys.argv[2])
samples = importlib.util.module_from_spec(spec)
spec.loader.exec_module(samples)
writer = samples.SharedWriter(Path(sys.argv[1]), samples.sample(), samples.CELLS)
print("ready", flush=True)
for number in range(30000):
    writer.write(samples.sample(number))
"""


@pytest.mark.parametrize("read", ["latest", "next"])
def test_no_reader_ever_sees_half_a_record(path, read):
    with subprocess.Popen([sys.executable, "-c", HAMMER, str(path), __file__], stdout=subprocess.PIPE) as writing:
        assert writing.stdout is not None
        assert writing.stdout.readline() == b"ready\n"
        reader, seen, before, count = SharedReader(path, sample(), CELLS), sample(-1), -1, 0
        first = None
        while before < 29999:
            ended = writing.poll() is not None
            if not getattr(reader, read)(seen):
                assert not ended or before == 29999, "nothing more comes"
                continue
            assert seen.number > before
            first = seen.number - reader.lost if first is None else first
            assert (seen.copies == seen.number).all()
            assert seen.last == seen.number % 256
            before, count = seen.number, count + 1
    if read == "next":
        assert first + count + reader.lost == 30000
