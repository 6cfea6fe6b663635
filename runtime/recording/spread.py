# SPDX-License-Identifier: Apache-2.0
"""How far figures of runs lie apart, and where one more would lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean, stdev
from typing import NamedTuple

CONFIDENCE = 0.99
"""With which one more figure of the same kind lies within a spread."""


class Spread(NamedTuple):
    """Of some figures.

    Attributes:
        least, most: of them.
        low, high: between which one more would lie.
    """

    least: float
    most: float
    low: float
    high: float

    def holds(self, figure: float) -> bool:
        """Whether a figure lies within; NaN does not."""
        return self.low <= figure <= self.high


def spread_of(figures: Sequence[float], resolution: float = 0.0) -> Spread:
    """The prediction interval for one more of some figures, taken as normal: mean -+ t s sqrt(1 + 1/n).

    The range of n figures alone would leave out one more with a probability of 2 / (n + 1). t is the quantile of
    Student's distribution with n - 1 degrees of freedom.

    Args:
        figures: of the same kind.
        resolution: of each; the interval goes beyond the range by that at least.

    Raises:
        ValueError: for fewer than two figures.
    """
    from scipy.stats import t

    count = len(figures)
    if count < 2:
        raise ValueError(f"{count} figures have no spread")
    least, most = min(figures), max(figures)
    quantile = float(t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))
    mean, reach = fmean(figures), quantile * stdev(figures) * math.sqrt(1.0 + 1.0 / count)
    return Spread(least, most, min(least - resolution, mean - reach), max(most + resolution, mean + reach))
