# SPDX-License-Identifier: Apache-2.0
"""What a loop read in a recorded run, given to it again on another clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from runtime.records import Record


def moved_in_time(record: Record, values: npt.NDArray[np.void], by_ns: int) -> list[bytes]:
    """Bodies of recorded values (n,) with every time that is set moved; a time is a field of nanoseconds."""
    moved = values.copy()
    for field in record.fields:
        if field.unit == "ns":
            times = moved[field.name]
            times[times != 0] += by_ns
    return [value.tobytes()[: record.cdr_size] for value in moved]


class RecordedPort:
    """An input port that gives, period by period, what was recorded, and after its end nothing more.

    Args:
        bodies: by number of the period.
        start_ns: begin of period 0.
        period_ns: of the loop.
        ended: called by a read after the last period.
    """

    def __init__(
        self, bodies: dict[int, bytes], periods: int, start_ns: int, period_ns: int, ended: Callable[[], None]
    ) -> None:
        self._bodies, self._periods = bodies, periods
        self._start_ns, self._period_ns, self._ended = start_ns, period_ns, ended

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record with what was read in the present period, if anything was."""
        period = (now_ns - self._start_ns) // self._period_ns
        if period >= self._periods:
            self._ended()
        body = self._bodies.get(period)
        if body is None:
            return False
        record.load(body)
        return True
