# SPDX-License-Identifier: Apache-2.0
"""Threads step the same tasks on a grid of releases; what is seen, skipped and logged follows from the times logged.

Nothing here says how fast a host is: every expectation is made from the times that the ticks themselves hold.
"""

import gc
import itertools
import os
import sys
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.executors import realtime
from runtime.executors.realtime import KEPT_US, SWITCH_INTERVAL_US, WAKE_EARLY_US, RealTime
from runtime.executors.tick import Tick, entries
from runtime.executors.timing import next_tick
from runtime.records import Record, int64
from runtime.tasks import Loop, Scheduled, Task

MS = 1_000_000
FAREWELL = -1
"""What the fast loop leaves to its port."""


class Count(Record):
    """A number with its time."""

    stamp_ns = int64("ns")
    value = int64()


class Relay(Task):
    """Writes its own count beside that of the other that it sees; `work` is called in each step."""

    def __init__(self, name, topic_in, topic_out, work=lambda step: None):
        self.name, self.work = name, work
        self.input, self.output = Count(topic_in), Count(topic_out)
        self.reads, self.writes = (self.input,), (self.output,)
        self.seen, self.threads = [], set()

    def step(self, now_ns):
        self.work(len(self.seen))
        self.seen.append((now_ns, self.input.value))
        self.threads.add(threading.get_ident())
        self.output.stamp_ns, self.output.value = now_ns, self.output.value + 1


class Outside:
    """Ports and sink in one."""

    dropped = 0

    def __init__(self):
        self.datagrams, self.sent = [], []

    def read(self, record, now_ns):
        record.stamp_ns = now_ns
        return True

    def write(self, *arguments):
        if len(arguments) == 1:
            self.datagrams.append(arguments[0])
        else:
            self.sent.append((arguments[0].value, arguments[1]))


def run(
    steps=60,
    fast_work=lambda step: None,
    slow_work=lambda step: None,
    outside=None,
    say=lambda sentence: None,
    processors=(),
):
    """Run until the fast loop has made so many steps; gives tasks, outside, and the ticks of each loop."""
    outside = outside or Outside()

    def fast(step):
        if step == steps - 1:
            executor.stop()
        fast_work(step)

    a, b = Relay("a", "/b", "/a", fast), Relay("b", "/a", "/b", slow_work)
    sensor, farewell = Count("/sensor"), Count("/a")
    farewell.value = FAREWELL
    loops = (
        Loop("fast", 2 * MS, 1 * MS, 80, (sensor,), (a.input,), (Scheduled(a),), (a.output,), (farewell,)),
        Loop("slow", 10 * MS, 6 * MS, 60, (), (b.input,), (Scheduled(b),), ()),
    )
    executor = RealTime(loops, {"/sensor": outside}, {"/a": outside}, outside, processors, say=say)
    executor.run()
    numbers = {channel.number: channel.record.topic for channel in executor.manifest.channels}
    ticks = {"/ugv/tick/fast": [], "/ugv/tick/slow": []}
    for datagram in outside.datagrams:
        number, body = next(entries(datagram))
        tick = Tick(numbers[number], {"received": 1})
        tick.load(body)
        ticks[tick.topic].append(tick)
    return a, b, outside, ticks["/ugv/tick/fast"], ticks["/ugv/tick/slow"]


def test_each_loop_is_a_thread_on_a_grid_of_releases():
    a, b, _, fast, slow = run()
    assert len(a.threads) == len(b.threads) == 1
    assert a.threads != b.threads
    assert len(fast) == len(a.seen) == 60
    for ticks, period_ns in ((fast, 2 * MS), (slow, 10 * MS)):
        start_ns = ticks[0].release_ns
        assert [tick.release_ns for tick in ticks] == [start_ns + tick.index * period_ns for tick in ticks]
        assert all(tick.now_ns - tick.release_ns == tick.wake_latency_ns >= 0 for tick in ticks)
        for before, after in itertools.pairwise(ticks):
            assert after.skipped == after.index - before.index - 1
    assert slow[0].release_ns - fast[0].release_ns == 1 * MS, "half a period of the fast loop"


def test_a_value_is_seen_from_release_plus_budget_on_and_never_before():
    _, b, _, fast, slow = run()
    releases = {tick.index + 1: tick.release_ns for tick in fast}
    consumed = [int(tick.consumed[0]) for tick in slow]
    assert consumed == sorted(consumed)
    assert consumed[-1] > 0
    for tick, sequence in zip(slow, consumed, strict=True):
        if sequence:
            assert releases[sequence] + 1 * MS <= tick.now_ns
    positions = {tick.index + 1: position for position, tick in enumerate(fast, start=1)}
    assert [value for _, value in b.seen] == [positions.get(sequence, 0) for sequence in consumed]


def test_loops_stay_on_their_processors_with_memory_that_stays_and_no_collector_between(monkeypatch):
    (one, *_), granted = sorted(os.sched_getaffinity(0)), []
    monkeypatch.setattr(realtime, "lock_memory", lambda: granted.append("locked") or "")
    monkeypatch.setattr(realtime, "unlock_memory", lambda: granted.append("unlocked"))
    found = []

    def look(step):
        found.append((os.sched_getaffinity(0), gc.isenabled(), granted[:]))

    run(fast_work=look, slow_work=look, processors=(one,))
    assert all(seen == ({one}, False, ["locked"]) for seen in found)
    assert granted == ["locked", "unlocked"]
    assert gc.isenabled()


def watch_sleeps(monkeypatch, look):
    """Have `look` called with the loop's name and its time to wake, whenever a loop goes to sleep."""

    class Alarm(realtime.Alarm):
        def sleep_until(self, wake_ns):
            look(threading.current_thread().name, wake_ns)
            super().sleep_until(wake_ns)

    monkeypatch.setattr(realtime, "Alarm", Alarm)


def test_the_fast_loop_is_woken_early_and_waits_for_its_release_awake(monkeypatch):
    woken = {"fast": [], "slow": []}
    watch_sleeps(monkeypatch, lambda loop, wake_ns: woken[loop].append(wake_ns))
    _, _, _, fast, slow = run()
    assert woken["fast"][: len(fast)] == [tick.release_ns - 1000 * WAKE_EARLY_US for tick in fast]
    assert woken["slow"][: len(slow)] == [tick.release_ns for tick in slow]
    assert all(tick.now_ns >= tick.release_ns for tick in fast)


def test_the_fast_loop_waits_shortly_for_the_interpreter_and_keeps_it_while_it_computes(monkeypatch):
    asleep, at_work, before = {"fast": [], "slow": []}, [], sys.getswitchinterval()
    watch_sleeps(monkeypatch, lambda loop, wake_ns: asleep[loop].append(sys.getswitchinterval()))
    run(fast_work=lambda step: at_work.append(sys.getswitchinterval()))
    assert asleep["fast"] == pytest.approx([SWITCH_INTERVAL_US * 1e-6] * len(asleep["fast"]))
    assert at_work == pytest.approx([KEPT_US * 1e-6] * 60)
    assert sys.getswitchinterval() == before


def test_what_is_not_granted_is_said_once_and_before_the_first_step(monkeypatch):
    said, before = [], []
    monkeypatch.setattr(realtime, "run_first", lambda priority: "no SCHED_FIFO here")
    run(fast_work=lambda step: before.append(tuple(said)), say=said.append)
    assert said.count("no SCHED_FIFO here") == 1
    assert "no SCHED_FIFO here" in before[0]


def test_a_stalled_loop_skips_whole_periods_and_counts_them():
    stalled = []

    def stall(step):
        if step == 20:
            until_ns = time.monotonic_ns() + 9 * MS
            while time.monotonic_ns() < until_ns:
                pass
            stalled.append(until_ns)

    _, _, _, fast, _ = run(fast_work=stall)
    after = fast[21]
    assert after.skipped >= 4
    assert after.release_ns >= stalled[0]
    assert after.index == fast[20].index + 1 + after.skipped
    assert fast[20].late == 1


def test_frames_leave_after_the_step_that_made_them():
    _, _, outside, fast, _ = run()
    sent = outside.sent[:-1]
    assert [value for value, _ in sent] == list(range(1, 61))
    assert all(sent_ns >= tick.now_ns for (_, sent_ns), tick in zip(sent, fast, strict=True))


@pytest.mark.parametrize("loop", ["fast", "slow"])
def test_what_one_loop_raises_ends_them_all_and_is_raised(loop):
    def fail(step):
        if step == 3:
            raise ZeroDivisionError("a task that fails")

    before, outside = threading.active_count(), Outside()
    with pytest.raises(ZeroDivisionError, match="a task that fails"):
        run(10**9, outside=outside, **{f"{loop}_work": fail})
    assert threading.active_count() == before
    assert [value for value, _ in outside.sent].index(FAREWELL) == len(outside.sent) - 1


def test_what_a_loop_leaves_is_sent_once_after_all_else_when_it_is_stopped():
    _, _, outside, fast, _ = run()
    assert [value for value, _ in outside.sent] == [*range(1, len(fast) + 1), FAREWELL]


def test_a_port_that_fails_at_the_end_too_does_not_hide_the_failure():
    class Broken(Outside):
        def write(self, *arguments):
            if len(arguments) == 2:
                raise ArithmeticError(f"{arguments[0].value}")

    with pytest.raises(ArithmeticError, match=r"^1$"):
        run(10**9, outside=Broken())


@given(st.integers(0, 10**6), st.integers(1, 10**8), st.integers(0, 10**14), st.integers(0, 10**10))
def test_the_next_tick_is_the_first_whose_release_has_not_passed(index, period_ns, start_ns, elapsed_ns):
    now_ns = start_ns + index * period_ns + elapsed_ns
    following, skipped = next_tick(index, start_ns, period_ns, now_ns)
    assert following == index + 1 + skipped
    assert skipped >= 0
    assert start_ns + following * period_ns >= now_ns
    assert skipped == 0 or start_ns + (following - 1) * period_ns < now_ns
