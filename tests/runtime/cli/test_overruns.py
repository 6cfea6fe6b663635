# SPDX-License-Identifier: Apache-2.0
"""An overrun is laid to the tick itself, to the wake or to an interruption."""

import numpy as np
import pytest

from runtime.cli.overruns import Causes, Slice, causes, typical_busy_ns

PERIOD_NS = 1_000_000


def slice_of(*rows):
    """Rows of (index, wake, busy, skipped), in us."""
    index, wake, busy, skipped = np.array(rows, np.int64).T
    return Slice(index, wake * 1000, busy * 1000, skipped, busy * 1000)


def one_overrun(wake, busy, need):
    """The cause of an overrun of a tick, times in shares of the period."""
    skipped = int(wake + busy)
    rows = (0, round(1000 * wake), round(1000 * busy), 0), (1 + skipped, 1, 100, skipped)
    found = causes(slice_of(*rows), PERIOD_NS, {0: round(need * PERIOD_NS), 1 + skipped: 100_000})
    return next(cause for cause in ("own", "late_wake", "interrupted") if getattr(found, cause))


def test_what_a_tick_needs_is_the_median_over_the_slices_that_ran_it():
    slices = [
        slice_of((0, 1, 100, 0), (1, 1, 200, 0)),
        slice_of((0, 1, 9000, 0), (1, 1, 5210, 0)),
        slice_of((0, 1, 110, 0), (2, 1, 5, 1)),
    ]
    assert typical_busy_ns(slices) == {0: 110_000, 1: 200_000}


def test_a_single_slice_does_not_tell_what_a_tick_needs():
    assert typical_busy_ns([slice_of((0, 1, 9000, 0))]) == {}
    assert typical_busy_ns([Slice(*[np.zeros(0, np.int64)] * 5)] * 3) == {}


@pytest.mark.parametrize(
    ("wake", "busy", "need", "cause"),
    [
        (0.01, 1.2, 1.1, "own"),
        (0.3, 0.8, 0.75, "own"),
        (0.8, 0.6, 0.55, "own"),
        (1.5, 1.2, 1.1, "own"),
        (0.8, 0.4, 0.4, "late_wake"),
        (1.5, 0.2, 0.2, "late_wake"),
        (0.8, 0.9, 0.3, "late_wake"),
        (0.8, 0.9, 0.1, "interrupted"),
        (0.01, 1.1, 0.1, "interrupted"),
        (0.45, 0.6, 0.5, "interrupted"),
    ],
    ids=[
        "more than a period",
        "more than a wake left",
        "woken late, but more than half a period",
        "woken too late, and more than a period",
        "woken too late for it",
        "woken a period late",
        "woken too late for it and interrupted",
        "woken late, but not too late for it",
        "interrupted",
        "woken within its share",
    ],
)
def test_an_overrun_is_laid_to_what_went_beyond_its_share(wake, busy, need, cause):
    assert one_overrun(wake, busy, need) == cause


def test_each_overrun_has_one_cause():
    one = slice_of(
        (0, 10, 1200, 0),  # dear by itself
        (2, 1500, 200, 1),  # woken too late
        (4, 10, 1100, 1),  # interrupted
        (6, 10, 100, 1),
        (7, 10, 100, 0),
    )
    assert causes(one, PERIOD_NS, {0: 1_150_000}) == Causes(1, 1, 1, periods=8, skipped=3)


def test_an_empty_tick_is_woken_late_if_it_would_have_overrun_with_its_tasks():
    empty = slice_of((0, 850, 10, 0), (1, 850, 10, 0), (2, 1, 10, 0))
    assert causes(empty, PERIOD_NS, {0: 200_000, 1: 100_000, 2: 100_000}) == Causes(0, 1, 0, periods=3, skipped=0)
