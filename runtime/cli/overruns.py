# SPDX-License-Identifier: Apache-2.0
"""Why ticks overran: the same inputs given to the same loops several times tell what a tick needs.

That is the median of what it took. Its thread's clock does not tell: it goes on while a virtual machine holds its
processor up, and says of empty ticks too that they computed for longer than their period.

A tick overruns if what it was late and what it took come to more than its period. Of that a wake may use half, which is
`WAKE_SHARE`: a tick that needs more than what is left of its period then overruns by its own compute, one that was
woken too late for what it needs by its wake, and any other since it was kept from its processor. A loop without tasks
is woken late as often as one with tasks if the same ticks would have overrun with what those need.
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
        compute_ns: wall time of its tasks.
    """

    index: IntArray
    wake_ns: IntArray
    busy_ns: IntArray
    skipped: IntArray
    compute_ns: IntArray


@dataclass(frozen=True)
class Causes:
    """Overruns of one slice by cause.

    Attributes:
        own: what the tick needs comes to more than its period less the wake, of which `WAKE_SHARE` counts at most.
        late_wake: not that, but woken too late for what it needs.
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
    if not len(index):
        return {}
    busy = np.concatenate([one.busy_ns for one in slices])
    order = np.argsort(index, kind="stable")
    numbers, begins, counts = np.unique(index[order], return_index=True, return_counts=True)
    groups = zip(numbers.tolist(), np.split(busy[order], begins[1:]), counts.tolist(), strict=True)
    least = max(2, len(slices) // 2 + 1)
    return {number: int(np.sort(group)[(count - 1) // 2]) for number, group, count in groups if count >= least}


def causes(one: Slice, period_ns: int, needs_ns: Mapping[int, int]) -> Causes:
    """Sort the overruns of a slice.

    Args:
        one: the slice.
        period_ns: of its loop.
        needs_ns: what ticks take as a rule with their tasks, by their number.
    """
    need_ns = np.array([needs_ns.get(number, 0) for number in one.index.tolist()], np.int64)
    own = need_ns > period_ns - np.minimum(one.wake_ns, WAKE_SHARE * period_ns)
    late = ~own & (one.wake_ns + need_ns > period_ns)
    overran = np.append(one.skipped[1:] > 0, False)
    skipped = int(one.skipped[1:].sum())
    return Causes(
        int((own & overran).sum()),
        int(late.sum()),
        int((overran & ~own & ~late).sum()),
        len(one.index) + skipped,
        skipped,
    )
