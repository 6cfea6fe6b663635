# SPDX-License-Identifier: Apache-2.0
"""A loop is told of its own overruns, and lockstep injects them as real time has them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.executors.lockstep import Lockstep
from runtime.executors.tick import TICK_TOPIC_PREFIX, entries
from runtime.executors.timing import TimingPort
from runtime.records import Record, int64, uint32
from runtime.signals import LoopTiming
from runtime.tasks import Loop, Scheduled, Task

MS = 1_000_000


class Seen(Record):
    stamp_ns = int64("ns")
    overruns = uint32()
    in_a_row = uint32()


class Watch(Task):
    name = "watch"

    def __init__(self):
        self.timing, self.output = LoopTiming("/timing"), Seen("/seen")
        self.reads, self.writes = (self.timing,), (self.output,)

    def step(self, now_ns):
        self.output.stamp_ns = now_ns
        self.output.overruns, self.output.in_a_row = self.timing.overruns, self.timing.overruns_in_a_row


class Nothing(list):
    """A world, and a sink that keeps what it is given."""

    dropped = 0

    def advance(self, until_ns):
        pass

    def write(self, datagram):
        self.append(datagram)


def lockstep(delays, until_ns=20 * MS):
    watch, sink = Watch(), Nothing()
    loop = Loop("fast", 2 * MS, MS, 80, (watch.timing,), (), (Scheduled(watch),), ())
    executor = Lockstep([loop], {}, {}, sink, sink, delays=delays)
    executor.run(until_ns, lambda now_ns: False)
    topics = {channel.number: channel.record for channel in executor.manifest.channels}
    ticks, seen = [], []
    for datagram in sink:
        for number, body in entries(datagram):
            record = topics[number].like()
            record.load(body)
            if record.topic == TICK_TOPIC_PREFIX + "fast":
                ticks.append(record)
            elif record.topic == "/seen":
                seen.append(record)
    return ticks, seen


def test_without_delays_no_period_is_skipped():
    ticks, seen = lockstep(lambda loop, index: 0)
    assert [tick.index for tick in ticks] == list(range(10))
    assert all(tick.skipped == 0 and not tick.late for tick in ticks)
    assert seen[-1].overruns == 0


def test_a_step_that_takes_two_and_a_half_periods_has_two_skipped():
    ticks, seen = lockstep(lambda loop, index: 5 * MS if index == 3 else 0)
    assert [tick.index for tick in ticks] == [0, 1, 2, 3, 6, 7, 8, 9]
    assert [tick.skipped for tick in ticks] == [0, 0, 0, 0, 2, 0, 0, 0]
    assert [tick.late for tick in ticks] == [0, 0, 0, 1, 0, 0, 0, 0]
    assert [(one.overruns, one.in_a_row) for one in seen] == [(0, 0)] * 4 + [(1, 1)] + [(1, 0)] * 3


def test_a_step_that_is_late_but_within_its_period_skips_nothing():
    ticks, _ = lockstep(lambda loop, index: 2 * MS if index == 3 else 0)
    assert [tick.index for tick in ticks] == list(range(10))
    assert [tick.late for tick in ticks] == [0, 0, 0, 1] + [0] * 6


@given(st.lists(st.integers(0, 4), max_size=60))
def test_the_port_counts_every_skip_and_the_present_row_of_overruns(skips):
    port, record = TimingPort(2 * MS), LoopTiming("/timing")
    for number, skipped in enumerate(skips, 1):
        port.begin(skipped, 0)
        before = record.to_bytes()
        news = port.read(record, 0)
        assert news == (before != record.to_bytes())
        assert record.skipped == sum(skips[:number])
        assert record.overruns == np.count_nonzero(skips[:number])
        row = next((i for i, skip in enumerate(reversed(skips[:number])) if skip == 0), number)
        assert record.overruns_in_a_row == row


@given(st.lists(st.integers(0, 100 * MS), min_size=1, max_size=40))
def test_a_gap_is_told_in_the_tick_after_it_and_only_there(gaps_ns):
    port, record, boot_ns = TimingPort(2 * MS), LoopTiming("/timing"), 7
    for number, gap_ns in enumerate(gaps_ns):
        boot_ns += gap_ns
        port.begin(0, boot_ns)
        port.read(record, 0)
        assert record.gap_ns == (gap_ns if number and gap_ns > 4 * MS else 0)


def test_a_suspended_computer_skips_no_period_but_its_loop_is_told_how_long_it_was_away():
    watch, sink, suspended_ns = Watch(), Nothing(), 0
    loop = Loop("fast", 2 * MS, MS, 80, (watch.timing,), (), (Scheduled(watch),), ())
    executor = Lockstep([loop], {}, {}, sink, sink, suspended=lambda: suspended_ns)
    executor.run(20 * MS, lambda now_ns: False)
    suspended_ns = 1000 * MS
    executor.run(22 * MS, lambda now_ns: False)
    assert (watch.timing.skipped, watch.timing.gap_ns) == (0, 1002 * MS)
    executor.run(24 * MS, lambda now_ns: False)
    assert watch.timing.gap_ns == 0
