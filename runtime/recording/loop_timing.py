# SPDX-License-Identifier: Apache-2.0
"""How the loops of a run kept their time: latencies, overruns, late wakes, and ticks that are missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording import layout, setup
from runtime.recording.continuity import Continuity, Gap
from runtime.recording.errors import LogError
from runtime.recording.log import Log, Signal

BODY_STATE, IMU_AGE = "/ugv/body_state", "imu_age_ns"
_OF_A_TICK = ("index", "release_ns", "now_ns", "skipped", "late", "wake_latency_ns", "compute_ns")


class DescribedLoop(NamedTuple):
    """A loop as the log describes it."""

    name: str
    period_ns: int
    budget_ns: int


class Percentiles(NamedTuple):
    """Of times, ns."""

    p50: float
    p99: float
    p999: float
    max: float


class LateWake(NamedTuple):
    """A tick that began late.

    Attributes:
        loop: name of the loop.
        tick: its index.
        begin_ns: when it began.
        late_ns: after its release.
    """

    loop: str
    tick: int
    begin_ns: int
    late_ns: int


@dataclass(frozen=True)
class LoopTimes:
    """How one loop kept its time.

    Attributes:
        loop: as described.
        ticks: number of ticks in the log.
        wake: latency of its wakes; None in virtual time, which knows none.
        compute: wall time of its tasks; None for a loop that has logged no tick.
        overruns: ticks before which whole periods were skipped.
        skipped: these periods.
        late: ticks whose results left after the budget.
        over_budget: ticks whose tasks took more wall time than the budget.
        gaps: where ticks are missing.
        late_wakes: ticks that began later than the bound.
        late_wake_bound_ns: this bound.
    """

    loop: DescribedLoop
    ticks: int
    wake: Percentiles | None
    compute: Percentiles | None
    overruns: int
    skipped: int
    late: int
    over_budget: int
    gaps: tuple[Gap, ...]
    late_wakes: tuple[LateWake, ...]
    late_wake_bound_ns: int

    @property
    def missing(self) -> int:
        """Ticks that are missing, at most; those before the log began do not count."""
        return sum(gap.missing for gap in self.gaps if gap.after >= 0)


def described_loops(log: Log) -> list[DescribedLoop]:
    """The loops that the log says it is of; none if it does not say.

    Raises:
        LogError: if what it says cannot be understood.
    """
    if setup.MANIFEST not in log.attachments:
        return []
    try:
        return [
            DescribedLoop(str(entry["name"]), max(1, int(entry["period_ns"])), int(entry["budget_ns"]))
            for entry in log.json(setup.MANIFEST)["loops"]
        ]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise LogError(f"{log.path}: {setup.MANIFEST} does not describe the loops") from None


def read_loop_times(log: Log) -> list[LoopTimes]:
    """The times of every loop that the log describes and has ticks of.

    Raises:
        LogError: if what the log holds as ticks are none.
    """
    loops = [loop for loop in described_loops(log) if TICK_TOPIC_PREFIX + loop.name in log.channels]
    signals = log.read_signals([TICK_TOPIC_PREFIX + loop.name for loop in loops])
    for topic, signal in signals.items():
        for name in _OF_A_TICK:
            if not _has_numbers(signal, name):
                raise LogError(f"{log.path}: {topic} has no whole number {name} in each of its messages")
    return [loop_times(loop, signals[TICK_TOPIC_PREFIX + loop.name], log.origin_ns) for loop in loops]


def loop_times(loop: DescribedLoop, ticks: Signal, origin_ns: int = 0, wake_bound_ns: int | None = None) -> LoopTimes:
    """The times of one loop.

    Args:
        loop: as described.
        ticks: its tick records.
        origin_ns: of the log, from which the times of late wakes and gaps are counted.
        wake_bound_ns: a wake later than this is late; a period of the loop if not given.
    """
    rows, bound_ns = ticks.values, loop.period_ns if wake_bound_ns is None else wake_bound_ns
    wake = rows["wake_latency_ns"]
    woken_late = np.flatnonzero(wake > bound_ns)
    return LoopTimes(
        loop=loop,
        ticks=len(rows),
        wake=percentiles(wake) if wake.any() else None,
        compute=percentiles(rows["compute_ns"]),
        overruns=int(np.count_nonzero(rows["skipped"])),
        skipped=int(rows["skipped"].sum(dtype=np.int64)),
        late=int(np.count_nonzero(rows["late"])),
        over_budget=int(np.count_nonzero(rows["compute_ns"] > loop.budget_ns)),
        gaps=_gaps(loop.name, rows, origin_ns),
        late_wakes=tuple(
            LateWake(loop.name, int(rows["index"][i]), int(rows["now_ns"][i]) - origin_ns, int(wake[i]))
            for i in woken_late.tolist()
        ),
        late_wake_bound_ns=bound_ns,
    )


def percentiles(values: npt.NDArray[np.int64]) -> Percentiles | None:
    """Of times; None of none."""
    if not len(values):
        return None
    return Percentiles(*(float(value) for value in np.percentile(values, (50.0, 99.0, 99.9, 100.0))))


def imu_age(*logs: Log) -> Percentiles | None:
    """Age of the inertial samples at the ticks that used them, of all logs of a run; None if they do not hold it.

    What the estimator leaves in its output before its first sample (`stamp_ns` 0) is no age.
    """
    return percentiles(np.concatenate([np.zeros(0, np.int64), *map(_imu_ages, logs)]))


def _imu_ages(log: Log) -> npt.NDArray[np.int64]:
    none = np.zeros(0, np.int64)
    if BODY_STATE not in log.channels or IMU_AGE not in dict(layout.fields_of(log.channels[BODY_STATE].definition)):
        return none
    signal = log.read_signal(BODY_STATE)
    if not (_has_numbers(signal, IMU_AGE) and _has_numbers(signal, "stamp_ns")):
        return none
    return signal.values[IMU_AGE][signal.values["stamp_ns"] > 0]


def _has_numbers(signal: Signal, field: str) -> bool:
    """Whether each value of a signal has one whole number of a name."""
    dtype = signal.values.dtype
    return field in (dtype.names or ()) and dtype[field].kind in "iu"


def _gaps(loop: str, rows: npt.NDArray[np.void], origin_ns: int) -> tuple[Gap, ...]:
    continuity = Continuity(loop)
    columns = (rows[name].tolist() for name in ("index", "skipped", "release_ns"))
    found = (continuity.take(i, skipped, at - origin_ns) for i, skipped, at in zip(*columns, strict=True))
    return tuple(gap for gap in found if gap is not None)
