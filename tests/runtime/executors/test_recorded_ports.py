# SPDX-License-Identifier: Apache-2.0
"""A recorded run is given again period by period, with every time that it holds moved along."""

import numpy as np

from runtime.executors.recorded_ports import RecordedPort, moved_in_time
from runtime.records import Record, float64, int64, int64_array, uint32


class Sample(Record):
    """Times among other things."""

    stamp_ns = int64("ns")
    sequence = int64()
    arrival_ns = int64_array(2, "ns")
    value = float64("m")
    count = uint32()


def values(count):
    """Samples of which only the first arrival is set."""
    table = np.zeros(count, Sample("/sample").dtype)
    table["stamp_ns"], table["sequence"] = np.arange(1, count + 1) * 100, np.arange(count) + 7
    table["arrival_ns"][:, 0], table["value"] = table["stamp_ns"] - 3, 0.5
    return table


def test_times_that_are_set_move_and_nothing_else():
    record, table = Sample("/sample"), values(3)
    before = table.copy()
    for body, value in zip(moved_in_time(record, table, 1_000_000), before, strict=True):
        record.load(body)
        assert record.stamp_ns == value["stamp_ns"] + 1_000_000
        assert record.arrival_ns.tolist() == [value["arrival_ns"][0] + 1_000_000, 0]
        assert (record.sequence, record.value, record.count) == (value["sequence"], 0.5, 0)
    assert (table == before).all()


def test_each_period_gives_what_was_read_in_it_and_after_the_last_the_end_is_told():
    record, told = Sample("/sample"), []
    bodies = dict(zip((0, 2), moved_in_time(record, values(2), 0), strict=True))
    port = RecordedPort(bodies, 3, start_ns=1000, period_ns=10, ended=lambda: told.append(True))
    assert [port.read(record, now_ns) for now_ns in (1000, 1004, 1010, 1019, 1020, 1029)] == [
        True,
        True,
        False,
        False,
        True,
        True,
    ]
    assert record.sequence == 8
    assert not told
    assert not port.read(record, 1030)
    assert told == [True]
