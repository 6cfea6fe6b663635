# SPDX-License-Identifier: Apache-2.0
"""An overrun is laid to the wake, to the tick itself or to an interruption."""

import numpy as np

from runtime.cli.overruns import Causes, Slice, causes, typical_busy_ns


def slice_of(*rows):
    """Rows of (index, wake, busy, skipped), in us."""
    index, wake, busy, skipped = np.array(rows, np.int64).T
    return Slice(index, wake * 1000, busy * 1000, skipped)


def test_what_a_tick_takes_by_itself_is_the_median_over_the_slices_that_ran_it():
    slices = [
        slice_of((0, 1, 100, 0), (1, 1, 200, 0)),
        slice_of((0, 1, 9000, 0), (1, 1, 210, 0)),
        slice_of((0, 1, 110, 0), (2, 1, 5, 1)),
    ]
    numbers, busy_ns = typical_busy_ns(slices)
    assert numbers.tolist() == [0, 1]
    assert busy_ns.tolist() == [110_000, 205_000]


def test_each_overrun_has_one_cause():
    one = slice_of(
        (0, 10, 1200, 0),  # dear by itself
        (2, 1500, 200, 1),  # woken too late
        (4, 10, 1100, 1),  # interrupted
        (6, 10, 100, 1),
        (7, 10, 100, 0),
    )
    assert causes(one, 1_000_000, np.array([0])) == Causes(1, 1, 1, periods=8, skipped=3)


def test_a_dear_tick_that_was_also_woken_too_late_is_a_late_wake():
    one = slice_of((0, 1000, 1200, 0), (3, 10, 100, 2))
    assert causes(one, 1_000_000, np.array([0])) == Causes(1, 0, 0, periods=4, skipped=2)
