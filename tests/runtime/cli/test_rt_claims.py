# SPDX-License-Identifier: Apache-2.0
"""What is claimed of the loops in real time is judged by figures of many slices; what was not measured is not shown."""

import numpy as np
import pytest

from runtime.cli.overruns import Slice, typical_busy_ns
from runtime.cli.rt_claims import claims, print_claims
from runtime.cli.rt_figures import figures_of, medians

PERIOD_NS = 1_000_000
REFERENCE = (5.0, 20.0, 40.0)


def slice_of(wake_us=10, compute_us=100, overrun=None):
    """Ten ticks, of which the last but one overran if given (wake, busy), us."""
    index, skipped = np.arange(10), np.zeros(10, np.int64)
    wake, compute = np.full(10, wake_us * 1000), np.full(10, compute_us * 1000)
    busy = compute + 20_000
    if overrun is not None:
        wake[8], busy[8] = (1000 * one for one in overrun)
        index[9], skipped[9] = 10, 1
    return Slice(index, wake, busy, skipped, compute)


def kept(ours, bare=None, reference=REFERENCE):
    needs_ns = typical_busy_ns(ours)
    figures = [figures_of(slices, PERIOD_NS, needs_ns) for slices in (ours, bare or [slice_of()] * 3)]
    return [claim.kept for claim in claims("1000 Hz, idle", *figures, reference)]


DEAR, LATE, INTERRUPTED = (10, 1100), (900, 200), (10, 1100)


def test_figures_are_medians_over_the_slices():
    figures = figures_of([slice_of(10, 100), slice_of(20, 300), slice_of(40, 200)], PERIOD_NS, {})
    assert figures.wake_us == pytest.approx((20.0,) * 3)
    assert figures.compute_us == pytest.approx((200.0,) * 3)
    assert figures.busy_us == pytest.approx((220.0,) * 3)
    assert (figures.dearest_us, figures.late, figures.own, figures.ticks) == (220.0, 0, 0, 30)


def test_no_slice_with_a_tick_has_no_figures():
    assert figures_of([], PERIOD_NS, {}) is None
    assert medians([[]]) is None
    assert medians([[1.0, 3.0], [5.0, 5.0]])[0] == pytest.approx(3.5)


@pytest.mark.parametrize(
    ("ours", "bare", "verdicts"),
    [
        ([slice_of()] * 3, None, [True, True, True]),
        ([slice_of(overrun=DEAR)] * 3, None, [False, True, True]),
        ([slice_of(), slice_of(), slice_of(overrun=LATE)], None, [True, True, True]),
        ([slice_of(overrun=LATE)] * 2 + [slice_of()], None, [True, False, False]),
        ([slice_of(overrun=LATE)] * 2 + [slice_of()], [slice_of(overrun=(990, 20))] * 3, [True, True, False]),
        ([slice_of(overrun=INTERRUPTED), slice_of(), slice_of()], None, [True, True, True]),
        ([slice_of(wake_us=29)] * 3, None, [True, True, True]),
        ([slice_of(wake_us=31)] * 3, None, [True, True, False]),
    ],
    ids=[
        "good",
        "own",
        "late once",
        "late",
        "as late as the bare loop",
        "interrupted",
        "ratio 1.45",
        "ratio 1.55",
    ],
)
def test_a_claim_is_kept_if_its_figures_are_within_its_bound(ours, bare, verdicts):
    assert kept(ours, bare) == verdicts


def test_late_wakes_are_told_as_a_median_and_in_all():
    slices = [slice_of(), slice_of(), slice_of(overrun=LATE)]
    ours = figures_of(slices, PERIOD_NS, typical_busy_ns(slices))
    late = claims("", ours, figures_of([slice_of()] * 3, PERIOD_NS, {}), None)[1]
    assert (late.measured, late.kept) == ("0 % to 0 %; in all 1 to 0", True)


def test_what_was_not_measured_is_not_shown(capsys):
    assert kept([slice_of()] * 3, reference=None) == [True, True, None]
    ours = figures_of([slice_of()] * 3, PERIOD_NS, {})
    assert [claim.kept for claim in claims("", ours, None, None)] == [True, None, None]
    nothing = claims("500 Hz, idle", None, None, None)
    assert [claim.kept for claim in nothing] == [None] * 3
    print_claims([*nothing, *claims("", figures_of([slice_of(99)] * 3, PERIOD_NS, {}), ours, REFERENCE)])
    told = capsys.readouterr().out
    assert told.count("not shown") == 3
    assert told.count("yes") == 2
    assert told.count("NO") == 1
