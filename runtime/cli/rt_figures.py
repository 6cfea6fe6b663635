# SPDX-License-Identifier: Apache-2.0
"""What several slices of one loop come to: percentiles as medians over the slices, and overruns by cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from runtime.cli.overruns import Slice, causes, typical_busy_ns

QUANTILES = (50.0, 99.0, 99.9)
Shares: TypeAlias = tuple[float, float, float]
"""The 50th, 99th and 99.9th percentile."""


@dataclass(frozen=True)
class Figures:
    """One loop over several slices.

    Attributes:
        wake_us, compute_us, busy_us: of wake latency, of the wall time of the tasks, and of that from waking until the
            tick is logged.
        dearest_us: the longest of the ticks' medians, None of a single slice.
        late_percent, interrupted_percent: of the periods overran by a late wake (of a loop without tasks: would have),
            or since their tick was kept from its processor; medians over the slices.
        late, own: overruns by a late wake, and by the loop's own compute, in all slices together.
        ticks: of all slices together.
    """

    wake_us: Shares
    compute_us: Shares
    busy_us: Shares
    dearest_us: float | None
    late_percent: float
    interrupted_percent: float
    late: int
    own: int
    ticks: int


def figures_of(slices: Sequence[Slice], period_ns: int, needs_ns: Mapping[int, int]) -> Figures | None:
    """The figures of a loop; None if no tick ran.

    Args:
        slices: of the loop.
        period_ns: of it.
        needs_ns: what its ticks need, or would if they had tasks, by their number.
    """
    wake = medians([one.wake_ns / 1e3 for one in slices])
    compute = medians([one.compute_ns / 1e3 for one in slices])
    busy = medians([one.busy_ns / 1e3 for one in slices])
    if wake is None or compute is None or busy is None:
        return None
    typical_ns = typical_busy_ns(slices)
    found = [causes(one, period_ns, needs_ns) for one in slices if len(one.index)]
    return Figures(
        wake,
        compute,
        busy,
        max(typical_ns.values()) / 1e3 if typical_ns else None,
        float(np.median([100.0 * one.late_wake / one.periods for one in found])),
        float(np.median([100.0 * one.interrupted / one.periods for one in found])),
        sum(one.late_wake for one in found),
        sum(one.own for one in found),
        sum(len(one.index) for one in slices),
    )


def medians(samples: Sequence[Sequence[float] | npt.NDArray[np.float64]]) -> Shares | None:
    """Medians over slices of the percentiles; slices in which nothing ran are left out."""
    samples = [one for one in samples if len(one)]
    if not samples:
        return None
    p50, p99, p999 = np.median([np.percentile(one, QUANTILES) for one in samples], axis=0)
    return float(p50), float(p99), float(p999)
