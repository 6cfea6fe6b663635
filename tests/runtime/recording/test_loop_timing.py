# SPDX-License-Identifier: Apache-2.0
"""What a log says of time: percentiles, overruns, late wakes, gaps, and when and why it begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.cli.main import main
from runtime.executors.clocks import ClockReading
from runtime.executors.tick import Tick
from runtime.recording.bags import Bags
from runtime.recording.beginning import beginning, clock_changes
from runtime.recording.continuity import Continuity
from runtime.recording.errors import LogError
from runtime.recording.log import Log, Signal
from runtime.recording.loop_timing import DescribedLoop, loop_times, read_loop_times
from runtime.recording.recorder_status import RecorderStatus
from runtime.recording.replay import Replay
from runtime.recording.report import report
from runtime.recording.run_data import load_run

LOOP = DescribedLoop("fast", 2_000_000, 1_000_000)
START_NS = 5_000_000_000_000


def ticks(*rows: dict[str, int]) -> Signal:
    """Tick records; the times follow from the indices."""
    tick = Tick("/ugv/tick/fast", {"received": 0})
    bodies = []
    for row in rows:
        tick.clear()
        for name, value in row.items():
            setattr(tick, name, value)
        tick.release_ns = row["index"] * LOOP.period_ns
        tick.now_ns = tick.release_ns + tick.wake_latency_ns
        bodies.append(tick.to_bytes().ljust(tick.dtype.itemsize, b"\0"))
    return Signal(np.zeros(len(rows), np.int64), np.frombuffer(b"".join(bodies), tick.dtype))


def test_what_was_skipped_is_told_from_what_is_missing():
    times = loop_times(
        LOOP,
        ticks(
            {"index": 0, "wake_latency_ns": 50_000},
            {"index": 1, "wake_latency_ns": 3_000_000, "compute_ns": 1_500_000},
            {"index": 4, "skipped": 2, "late": 1},
            {"index": 7, "skipped": 1},
            {"index": 8},
        ),
    )
    assert (times.ticks, times.overruns, times.skipped, times.late, times.over_budget) == (5, 2, 3, 1, 1)
    assert [(gap.after, gap.before, gap.missing) for gap in times.gaps] == [(4, 7, 1)]
    assert times.missing == 1
    assert [(s.tick, s.begin_ns, s.late_ns) for s in times.late_wakes] == [(1, 5_000_000, 3_000_000)]
    assert times.wake is not None
    assert times.wake.max == 3_000_000


def test_virtual_time_has_no_wakes():
    assert loop_times(LOOP, ticks({"index": 0}, {"index": 1})).wake is None
    assert loop_times(LOOP, ticks()).compute is None


@given(
    steps=st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=40),
)
def test_a_gap_is_found_exactly_where_a_tick_was_dropped(steps):
    """Each step skips some periods; some of the ticks are dropped on the way to the log."""
    continuity, index, dropped, gaps, expected = Continuity("fast"), -1, 0, 0, 0
    for skipped, keep in steps:
        skipped = 0 if index < 0 else skipped
        index += 1 + skipped
        if keep:
            gaps += continuity.take(index, skipped, index) is not None
            expected += dropped > 0
            dropped = 0
        else:
            dropped += 1
    assert gaps == expected


@pytest.fixture
def live_log(toy, tmp_path) -> Path:
    """A log on a machine's clock, with a late wake, skipped periods, missing ticks, and a clock that was set."""
    utc = [1_800_000_000 * 10**9]
    status = RecorderStatus()
    bags = Bags(
        tmp_path,
        toy.setup(),
        status,
        lambda sentence: None,
        toy.small_chunks,
        "toy-before",
        lambda: ClockReading(START_NS, utc[0], START_NS),
    )
    run = toy.datagrams(delays=lambda loop, index: 5_000_000 * (loop == "fast" and index == 40))
    for number, datagram in enumerate(run):
        if not 60 <= number < 63:
            bags.write(toy.late(datagram, START_NS, 2_500_000 if number == 80 else 30_000))
        if number == 100:
            utc[0] += 9 * 10**9
            bags.tend()
    bags.close()
    [directory] = tmp_path.iterdir()
    return directory


def test_times_of_a_live_log_count_from_its_beginning(toy, live_log):
    log = Log(live_log)
    assert log.origin_ns == log.start_ns == START_NS
    fast = read_loop_times(log)[0]
    assert (fast.skipped, fast.missing, len(fast.late_wakes)) == (2, 3, 1)
    assert 0 < fast.late_wakes[0].begin_ns < 500_000_000
    assert 0 < fast.gaps[0].begin_ns < fast.gaps[0].end_ns < 500_000_000
    result = Replay(log, toy.loops(), "toy").run(from_s=0.2)
    assert result.stretches
    assert all(0 <= s.begin_ns < s.end_ns < 500_000_000 for s in result.stretches)


@pytest.mark.parametrize("field", ["release_ns", "skipped"])
def test_a_log_whose_ticks_lack_a_field_is_refused(live_log, monkeypatch, field):
    log = Log(live_log)
    read = log.read_signals

    def lacking(topics):
        left = {topic: [name for name in s.values.dtype.names if name != field] for topic, s in read(topics).items()}
        return {topic: Signal(s.log_ns, s.values[left[topic]]) for topic, s in read(topics).items()}

    monkeypatch.setattr(log, "read_signals", lacking)
    with pytest.raises(LogError, match=f"has no whole number {field} in each of its messages"):
        read_loop_times(log)


def test_a_live_log_says_when_and_why_it_begins(live_log):
    log = Log(live_log)
    assert beginning(log) == (
        "begins at 2027-01-15 08:00:00 UTC with the first ticks; the log before it is toy-before "
        "(the recorder was started)"
    )
    assert clock_changes(log) == ["the system clock was set +9.000 s, noticed at 0.000 s"]


def test_info_lists_what_is_missing(live_log, capsys):
    assert main(["log", "info", str(live_log)]) == 0
    said = capsys.readouterr().out
    assert "fast: up to 3 ticks are missing between tick " in said
    assert "fast woke 2.5 ms late at 0." in said
    assert "begins at 2027-01-15 08:00:00 UTC" in said
    assert "the system clock was set +9.000 s" in said


def test_the_report_shows_wakes_and_gaps(live_log):
    page = report(load_run(live_log))
    for part in ("<h2>Time</h2>", "<h2>Wakes</h2>", "Gaps", "up to 3 ticks are missing", "2.5 ms late at 0."):
        assert part in page
    assert "Up to 3 ticks of loop fast are missing, in 1 place." in page
    assert "There is no summary.json" not in page


def test_the_report_of_virtual_time_shows_no_wakes(recorded):
    page = report(load_run(recorded))
    assert "<h2>Time</h2>" in page
    assert "<h2>Wakes</h2>" not in page
