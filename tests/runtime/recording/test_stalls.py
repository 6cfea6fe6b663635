# SPDX-License-Identifier: Apache-2.0
"""What keeps a loop from its work is seen in its ticks, and counts once wherever it is seen."""

import numpy as np
import pytest

from runtime.executors.tick import Tick
from runtime.recording.stalls import Stall, StallBound, explanation, stalled_ns, stalls_in
from runtime.signals import Fault

MS = 1_000_000
AT_NS = 800 * MS
TICK = Tick("", {"received": 1}).dtype
IMU = StallBound(Fault.STALE_IMU, ("link", "sim"), 16 * MS, 20 * MS)


def ticks_of(count, period_ms=2):
    ticks = np.zeros(count, TICK)
    ticks["index"] = np.arange(count)
    ticks["release_ns"] = ticks["index"] * period_ms * MS
    return ticks


@pytest.mark.parametrize(
    ("stalls", "kept_ms"),
    [
        ([("sim", -20, 10), ("link", -10, 8)], 18),
        ([("link", -20, 7), ("link", -12, 5), ("link", -5, 5)], 17),
        ([("sim", -20, 12), ("link", -18, 12)], 14),
        ([("sim", -20, 12), ("link", -18, 4)], 12),
        ([("sim", -100, 90)], 10),
        ([("link", -3, 30)], 3),
    ],
    ids=["one after the other", "several of one loop", "overlapping", "within", "begun before", "going on after"],
)
def test_stalls_count_together_but_each_moment_once_and_only_in_its_time(stalls, kept_ms):
    found = [Stall(loop, AT_NS + at_ms * MS, length_ms * MS) for loop, at_ms, length_ms in stalls]
    assert stalled_ns(found, AT_NS - 20 * MS, AT_NS) == kept_ms * MS
    stall, kept_ns = explanation(IMU, found, AT_NS)
    assert kept_ns == kept_ms * MS
    assert (stall is not None) is (kept_ms > 16)


def test_a_stall_is_told_in_its_whole_length_and_several_as_one():
    (several, _), (long, _) = (
        explanation(IMU, [Stall("link", AT_NS + at_ms * MS, length_ms * MS) for at_ms, length_ms in stalls], AT_NS)
        for stalls in ([(-20, 7), (-12, 11)], [(-70, 68)])
    )
    assert several == Stall("link", AT_NS - 12 * MS, 18 * MS)
    assert long == Stall("link", AT_NS - 70 * MS, 68 * MS)


def test_what_a_loop_computed_itself_is_no_stall():
    ticks = ticks_of(5)
    ticks["compute_ns"], ticks["cpu_ns"] = 30 * MS, [30 * MS, 28 * MS, 29 * MS, 30 * MS, 30 * MS]
    assert stalls_in("wbc", ticks, 2 * MS) == [Stall("wbc", 2 * MS, 2 * MS)]


def test_periods_that_were_skipped_have_passed_whatever_wake_and_step_took():
    ticks = ticks_of(4)
    ticks["index"][2:] += 4
    ticks["release_ns"] = ticks["index"] * 2 * MS
    ticks["skipped"][2], ticks["cpu_ns"] = 4, MS
    assert stalls_in("wbc", ticks) == [Stall("wbc", 2 * MS, 7 * MS)]


def test_a_loop_that_does_not_measure_its_computing_tells_all_by_wake_and_step():
    ticks = ticks_of(4)
    ticks["index"][2:] += 4
    ticks["release_ns"] = ticks["index"] * 2 * MS
    ticks["skipped"][2], ticks["compute_ns"][2] = 4, 9 * MS
    assert stalls_in("sim", ticks) == [Stall("sim", 12 * MS, 9 * MS)]


def test_of_ticks_that_are_missing_in_the_log_nothing_is_known():
    ticks = ticks_of(4)
    ticks["index"][2:] += 5
    ticks["release_ns"] = ticks["index"] * 2 * MS
    ticks["skipped"][2] = 4
    assert stalls_in("wbc", ticks) == []
