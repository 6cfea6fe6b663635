# SPDX-License-Identifier: Apache-2.0
"""Why ticks overran: the same inputs given to the same loops several times tell what a tick takes by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Slice:
    """One loop over some seconds, tick by tick.

    Attributes:
        index: number of each tick.
        wake_ns: wake latency of each.
        busy_ns: wall time from waking until it was logged.
        skipped: periods skipped before each.
    """

    index: IntArray
    wake_ns: IntArray
    busy_ns: IntArray
    skipped: IntArray


@dataclass(frozen=True)
class Causes:
    """Overruns of one slice by cause.

    Attributes:
        late_wake: woken a whole period late or more: even an empty tick would have overrun.
        own: the tick takes a period or more in most slices.
        interrupted: neither; the tick was kept from its processor.
        periods: of the slice, those skipped among them.
        skipped: of these.
    """

    late_wake: int
    own: int
    interrupted: int
    periods: int
    skipped: int


def typical_busy_ns(slices: Sequence[Slice]) -> tuple[IntArray, npt.NDArray[np.float64]]:
    """Numbers of the ticks (n,) that ran in most slices, and the median wall time of each, ns (n,).

    What others delay is not the same tick in most slices; a wait for another loop of the same process is, and counts.
    """
    index = np.concatenate([one.index for one in slices])
    busy = np.concatenate([one.busy_ns for one in slices])
    order = np.argsort(index, kind="stable")
    numbers, begins, counts = np.unique(index[order], return_index=True, return_counts=True)
    groups = np.split(busy[order], begins[1:])
    most = counts > len(slices) // 2
    medians = np.array([np.median(group) for group, taken in zip(groups, most, strict=True) if taken])
    return numbers[most], medians


def causes(one: Slice, period_ns: int, dear: IntArray) -> Causes:
    """Sort the overruns of a slice.

    Args:
        one: the slice.
        period_ns: of its loop.
        dear: numbers of the ticks that take a period or more by themselves.
    """
    overran = np.flatnonzero(one.skipped[1:])
    late = one.wake_ns[overran] >= period_ns
    own = ~late & np.isin(one.index[overran], dear)
    interrupted = len(overran) - int(late.sum()) - int(own.sum())
    skipped = int(one.skipped[1:].sum())
    return Causes(int(late.sum()), int(own.sum()), interrupted, len(one.index) + skipped, skipped)
