# SPDX-License-Identifier: Apache-2.0
"""Why ticks overran: the same inputs given to the same loops several times tell what a tick takes by itself.

A tick overruns if what it was late and what it took come to more than its period. Of that a wake may use half, which is
`WAKE_SHARE`: a tick that needs more than what is left of its period then overruns by its own compute, one that does not
but was woken later by its wake, and any other since it was kept from its processor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]


WAKE_SHARE = 0.5
"""Of a period, by which a tick may be woken late and yet have to be in time."""


@dataclass(frozen=True)
class Slice:
    """One loop over some seconds, tick by tick.

    Attributes:
        index: number of each tick.
        wake_ns: wake latency of each.
        busy_ns: wall time from waking until it was logged.
        skipped: periods skipped before each.
        compute_ns, cpu_ns: wall time and processor time of its tasks.
    """

    index: IntArray
    wake_ns: IntArray
    busy_ns: IntArray
    skipped: IntArray
    compute_ns: IntArray
    cpu_ns: IntArray


@dataclass(frozen=True)
class Causes:
    """Overruns of one slice by cause.

    Attributes:
        own: what the tick needs comes to more than its period less the wake, of which `WAKE_SHARE` counts at most.
        late_wake: not that, but woken later than `WAKE_SHARE` of the period.
        interrupted: neither; the tick was kept from its processor.
        periods: of the slice, those skipped among them.
        skipped: of these.
    """

    own: int
    late_wake: int
    interrupted: int
    periods: int
    skipped: int


def typical_busy_ns(slices: Sequence[Slice]) -> dict[int, int]:
    """Median wall time, ns, of each tick that ran in most slices and more than once, by its number.

    What others delay is not the same tick in most slices; a wait for another loop of the same process is, and counts.
    Of two medians it is the lower.
    """
    index = np.concatenate([one.index for one in slices])
    busy = np.concatenate([one.busy_ns for one in slices])
    order = np.argsort(index, kind="stable")
    numbers, begins, counts = np.unique(index[order], return_index=True, return_counts=True)
    groups = zip(numbers.tolist(), np.split(busy[order], begins[1:]), counts.tolist(), strict=True)
    least = max(2, len(slices) // 2 + 1)
    return {number: int(np.sort(group)[(count - 1) // 2]) for number, group, count in groups if count >= least}


def causes(one: Slice, period_ns: int, typical_ns: Mapping[int, int]) -> Causes:
    """Sort the overruns of a slice.

    Args:
        one: the slice.
        period_ns: of its loop.
        typical_ns: what ticks take as a rule, by their number; a tick needs that, or its processor time if it is more.
    """
    overran = np.flatnonzero(one.skipped[1:])
    wake_ns, granted_ns = one.wake_ns[overran], WAKE_SHARE * period_ns
    typical = np.array([typical_ns.get(number, 0) for number in one.index[overran].tolist()], np.int64)
    own = np.maximum(one.cpu_ns[overran], typical) > period_ns - np.minimum(wake_ns, granted_ns)
    late = ~own & (wake_ns > granted_ns)
    interrupted = len(overran) - int(own.sum()) - int(late.sum())
    skipped = int(one.skipped[1:].sum())
    return Causes(int(own.sum()), int(late.sum()), interrupted, len(one.index) + skipped, skipped)
