# SPDX-License-Identifier: Apache-2.0
"""What happens to the clocks of the machine is seen, told apart and counted; a busy machine is not taken for it."""

import time

from hypothesis import given
from hypothesis import strategies as st

from runtime.executors import clocks
from runtime.executors.clocks import LOOK_EVERY_NS, STEP_NS, ClockReading, ClockWatch, read_clocks

UTC_NS = 10**18
SLEWED_NS = 500_000
"""The most that a kernel steers a clock by in a second."""


@given(ran=st.integers(0, 10**10), set_by=st.integers(-(10**12), 10**12), suspended=st.integers(0, 10**12))
def test_a_step_of_the_clock_is_told_from_a_suspension(ran, set_by, suspended):
    watch = ClockWatch(ClockReading(0, UTC_NS, 0))
    said = watch.look(ClockReading(ran, UTC_NS + ran + suspended + set_by, ran + suspended))
    if suspended > STEP_NS:
        assert said == f"the system was suspended for {suspended / 1e9:.3f} s"
        assert (watch.steps, watch.suspends) == (0, 1)
    elif abs(set_by) > STEP_NS:
        assert said == f"the system clock was set {set_by / 1e9:+.3f} s"
        assert (watch.steps, watch.suspends) == (1, 0)
    else:
        assert said == ""
        assert (watch.steps, watch.suspends) == (0, 0)


def test_each_is_counted_once_and_a_clock_that_is_steered_is_not():
    watch = ClockWatch(ClockReading(0, UTC_NS, 0))
    now_ns = set_by_ns = asleep_ns = 0
    for step_ns, suspended_ns in ((0, 0), (3600 * 10**9, 0), (0, 0), (-3600 * 10**9, 0), (0, 60 * 10**9), (0, 0)):
        now_ns += LOOK_EVERY_NS
        set_by_ns, asleep_ns = set_by_ns + step_ns + SLEWED_NS, asleep_ns + suspended_ns
        watch.look(ClockReading(now_ns, UTC_NS + now_ns + asleep_ns + set_by_ns, now_ns + asleep_ns))
    assert (watch.steps, watch.suspends) == (2, 1)


def test_a_reading_that_was_preempted_is_taken_again(monkeypatch):
    held_up = iter([0, STEP_NS, 2 * STEP_NS, 2 * STEP_NS])
    monkeypatch.setattr(clocks.time, "monotonic_ns", lambda: next(held_up))
    assert read_clocks().monotonic_ns == 2 * STEP_NS


def test_undisturbed_clocks_are_not_suspended():
    before = time.monotonic_ns()
    watch = ClockWatch(read_clocks())
    watch.look(read_clocks())
    assert watch.suspends == 0
    assert read_clocks().monotonic_ns >= before
