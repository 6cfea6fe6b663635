# SPDX-License-Identifier: Apache-2.0
"""Records of another process enter a loop, whichever of the two was there first."""

from runtime.executors.shared_ports import (
    EVENT_CELLS,
    LOOK_AGAIN_NS,
    EventPort,
    LatestPort,
    event_writer,
    latest_writer,
)
from runtime.records import Record, int64
from runtime.signals import OperatorEvent


class Value(Record):
    stamp_ns = int64("ns")
    value = int64()


def write(writer, *values):
    record = Value("/ugv/value")
    for value in values:
        record.value = value
        writer.write(record)


def read_all(port, now_ns=0):
    record, values = Value("/ugv/value"), []
    while port.read(record, now_ns):
        values.append(record.value)
    return values


def test_of_measurements_only_the_newest_counts(tmp_path):
    writer, port = latest_writer(tmp_path, Value("/ugv/value")), LatestPort(tmp_path)
    write(writer, 1, 2, 3)
    assert read_all(port) == [3]
    write(writer, 4)
    assert read_all(port) == [4]
    assert read_all(port) == []


def test_of_events_each_counts(tmp_path):
    writer, port = event_writer(tmp_path, Value("/ugv/value")), EventPort(tmp_path)
    write(writer, 1, 2, 3)
    assert read_all(port) == [1, 2, 3]


def test_events_that_were_overwritten_are_told_in_the_next(tmp_path):
    event = OperatorEvent("/ugv/operator_event")
    writer, port = event_writer(tmp_path, event), EventPort(tmp_path)
    seen, found = event.like(), []
    assert not port.read(seen, 0)
    for sequence in range(EVENT_CELLS + 4):
        event.sequence = sequence
        writer.write(event)
    while port.read(seen, 0):
        found.append((seen.sequence, int(seen.lost)))
    assert found == [(sequence, 5) for sequence in range(5, EVENT_CELLS + 4)]


def test_events_of_the_time_before_a_port_were_said_to_another(tmp_path):
    event = OperatorEvent("/ugv/operator_event")
    writer, port, seen = event_writer(tmp_path, event), EventPort(tmp_path), event.like()
    for stamp_ns in range(2 * EVENT_CELLS):
        event.stamp_ns = stamp_ns
        writer.write(event)
    found = []
    while port.read(seen, 2 * EVENT_CELLS - 3):
        found.append((int(seen.stamp_ns), int(seen.lost)))
    assert found == [(2 * EVENT_CELLS - 3 + number, 0) for number in range(3)]


def test_a_writer_of_another_layout_takes_nothing_from_a_port_and_is_not_read(tmp_path):
    writer, port = latest_writer(tmp_path, Value("/ugv/value")), LatestPort(tmp_path)
    write(writer, 1)
    assert read_all(port) == [1]
    writer.close()
    other = latest_writer(tmp_path, OperatorEvent("/ugv/value"))
    other.write(OperatorEvent("/ugv/value"))
    assert read_all(port, LOOK_AGAIN_NS) == []
    other.close()
    write(latest_writer(tmp_path, Value("/ugv/value")), 2)
    assert read_all(port, 2 * LOOK_AGAIN_NS) == [2]


def test_a_port_finds_a_writer_that_comes_later(tmp_path):
    port = LatestPort(tmp_path)
    assert read_all(port, 0) == []
    write(latest_writer(tmp_path, Value("/ugv/value")), 5)
    assert read_all(port, LOOK_AGAIN_NS - 1) == []
    assert read_all(port, LOOK_AGAIN_NS) == [5]


def test_a_writer_that_starts_anew_carries_on(tmp_path):
    writer, port = event_writer(tmp_path, Value("/ugv/value")), EventPort(tmp_path)
    write(writer, 1)
    assert read_all(port) == [1]
    writer.close()
    write(event_writer(tmp_path, Value("/ugv/value")), 2)
    assert read_all(port) == [2]
