# SPDX-License-Identifier: Apache-2.0
"""Stamps of messages become times of the loops, or are refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.link.clocks import Instant, StampWindow, instant
from runtime.messages.errors import MessageError

UNIX = 1_700_000_000_000_000_000
NOW = Instant(5_000_000_000, UNIX)
AGE_MAX, FUTURE_MAX = 100_000_000, 20_000_000


def later(ns: int, step_ns: int = 0) -> Instant:
    """Some time after NOW; the unix clock has been set forward meanwhile."""
    return Instant(NOW.monotonic_ns + ns, NOW.unix_ns + ns + step_ns)


@given(st.integers(-10 * AGE_MAX, 10 * AGE_MAX))
def test_a_stamp_is_as_old_on_both_clocks(age_ns):
    window = StampWindow(AGE_MAX, FUTURE_MAX)
    try:
        found = window.monotonic_ns(NOW.unix_ns - age_ns, NOW)
    except MessageError as error:
        assert str(error) == ("the stamp is too old" if age_ns > 0 else "the stamp is in the future")
        assert not -FUTURE_MAX <= age_ns <= AGE_MAX
    else:
        assert found == NOW.monotonic_ns - max(age_ns, 0), "what is a little ahead counts as of now"


def test_no_stamp_means_now():
    assert StampWindow(AGE_MAX, FUTURE_MAX).monotonic_ns(0, NOW) == NOW.monotonic_ns


@pytest.mark.parametrize("back_ns", [0, 1, 5_000_000])
def test_time_that_stands_still_or_runs_backwards_is_refused(back_ns):
    window = StampWindow(AGE_MAX, FUTURE_MAX)
    window.monotonic_ns(UNIX, NOW)
    with pytest.raises(MessageError, match="not newer"):
        window.monotonic_ns(UNIX - back_ns, later(1_000_000))
    assert window.monotonic_ns(UNIX + 2_000_000, later(3_000_000)) == NOW.monotonic_ns + 2_000_000


@pytest.mark.parametrize("step_ns", [-3600 * 10**9, 3600 * 10**9])
def test_a_step_of_the_clock_costs_only_what_was_on_its_way(step_ns):
    window = StampWindow(AGE_MAX, FUTURE_MAX)
    window.monotonic_ns(UNIX, NOW)
    after = later(2_000_000, step_ns)
    with pytest.raises(MessageError):
        window.monotonic_ns(UNIX + 1_000_000, after)
    assert window.monotonic_ns(after.unix_ns - 100_000, after) == after.monotonic_ns - 100_000


def test_times_go_back_to_unix():
    assert NOW.unix(NOW.monotonic_ns - 7) == UNIX - 7
    assert instant().unix_ns > UNIX
