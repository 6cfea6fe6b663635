# SPDX-License-Identifier: Apache-2.0
"""An overrun is laid to the tick itself, to the wake or to an interruption."""

import numpy as np
import pytest

from runtime.cli.overruns import Causes, Slice, causes, typical_busy_ns

PERIOD_NS = 1_000_000


def slice_of(*rows):
    """Rows of (index, wake, busy, cpu, skipped), in us."""
    index, wake, busy, cpu, skipped = np.array(rows, np.int64).T
    return Slice(index, wake * 1000, busy * 1000, skipped, busy * 1000, cpu * 1000)


def one_overrun(wake, busy, cpu, typical=0):
    """The cause of an overrun of a tick, times in shares of the period."""
    row = (0, *(round(1000 * share) for share in (wake, busy, cpu)), 0)
    skipped = int(wake + busy)
    found = causes(slice_of(row, (1 + skipped, 1, 100, 100, skipped)), PERIOD_NS, {0: round(typical * PERIOD_NS)})
    return next(cause for cause in ("own", "late_wake", "interrupted") if getattr(found, cause))


def test_what_a_tick_takes_by_itself_is_the_median_over_the_slices_that_ran_it():
    slices = [
        slice_of((0, 1, 100, 90, 0), (1, 1, 200, 90, 0)),
        slice_of((0, 1, 9000, 90, 0), (1, 1, 5210, 90, 0)),
        slice_of((0, 1, 110, 90, 0), (2, 1, 5, 5, 1)),
    ]
    assert typical_busy_ns(slices) == {0: 110_000, 1: 200_000}


def test_a_single_slice_does_not_tell_what_a_tick_takes_by_itself():
    assert typical_busy_ns([slice_of((0, 1, 9000, 90, 0))]) == {}


@pytest.mark.parametrize(
    ("wake", "busy", "cpu", "typical", "cause"),
    [
        (0.01, 1.2, 1.1, 0.0, "own"),
        (0.3, 0.8, 0.75, 0.0, "own"),
        (0.01, 1.2, 0.1, 1.1, "own"),
        (0.8, 0.6, 0.55, 0.0, "own"),
        (1.5, 1.2, 1.1, 0.0, "own"),
        (0.8, 0.4, 0.4, 0.0, "late_wake"),
        (0.8, 0.4, 0.4, 0.4, "late_wake"),
        (1.5, 0.2, 0.2, 0.0, "late_wake"),
        (0.8, 0.9, 0.1, 0.1, "late_wake"),
        (0.01, 1.1, 0.1, 0.1, "interrupted"),
        (0.45, 0.6, 0.5, 0.5, "interrupted"),
    ],
    ids=[
        "more than a period",
        "more than a wake left",
        "as a rule",
        "woken late, but more than half a period",
        "woken too late, and more than a period",
        "woken late, and little to do",
        "the same as a rule",
        "woken a period late",
        "woken late and interrupted",
        "interrupted",
        "woken within its share",
    ],
)
def test_an_overrun_is_laid_to_what_went_beyond_its_share(wake, busy, cpu, typical, cause):
    assert one_overrun(wake, busy, cpu, typical) == cause


def test_each_overrun_has_one_cause():
    one = slice_of(
        (0, 10, 1200, 1150, 0),  # dear by itself
        (2, 1500, 200, 190, 1),  # woken too late
        (4, 10, 1100, 200, 1),  # interrupted
        (6, 10, 100, 90, 1),
        (7, 10, 100, 90, 0),
    )
    assert causes(one, PERIOD_NS, {}) == Causes(1, 1, 1, periods=8, skipped=3)
