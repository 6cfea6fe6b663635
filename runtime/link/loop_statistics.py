# SPDX-License-Identifier: Apache-2.0
"""How a loop keeps its time, from its ticks."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

import numpy as np

from runtime.executors.tick import Tick

_KEPT = 1000
_NS_PER_US = 1000.0


class LoopStatistics:
    """Counts since the link began to listen, and times of the last thousand ticks.

    Attributes:
        ticks, skipped, late: of the loop.
        missed: ticks whose datagrams did not arrive here.
        dropped: datagrams that the recorder did not take, as the loop counts them.
    """

    def __init__(self) -> None:
        self.ticks = self.skipped = self.late = self.missed = self.dropped = 0
        self._following: int | None = None
        self._wake: deque[int] = deque(maxlen=_KEPT)
        self._compute: deque[int] = deque(maxlen=_KEPT)

    def take(self, tick: Tick) -> None:
        """Take up a tick."""
        self.ticks += 1
        self.skipped += tick.skipped
        self.late += tick.late
        self.dropped = tick.dropped
        if self._following is not None and tick.index > self._following + tick.skipped:
            self.missed += tick.index - self._following - tick.skipped
        self._following = tick.index + 1
        self._wake.append(tick.wake_latency_ns)
        self._compute.append(tick.compute_ns)

    def figures(self) -> dict[str, float]:
        """The counts, and the times in microseconds."""
        counts = {"ticks": self.ticks, "skipped": self.skipped, "late": self.late, "missed": self.missed}
        times = {"wake_us": self._wake, "compute_us": self._compute}
        return counts | {key: value for name, kept in times.items() for key, value in spread(name, kept).items()}


def spread(name: str, times_ns: Collection[int]) -> dict[str, float]:
    """Median, 99th percentile and largest of some times, in microseconds."""
    if not times_ns:
        return {}
    median, high, largest = (np.percentile(np.fromiter(times_ns, float), (50, 99, 100)) / _NS_PER_US).round(1).tolist()
    return {f"{name}_p50": median, f"{name}_p99": high, f"{name}_max": largest}
