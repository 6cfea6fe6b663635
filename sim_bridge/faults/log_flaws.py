# SPDX-License-Identifier: Apache-2.0
"""What the log of a fault lacks: it is to be whole up to the fault, and to go on after it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording.log import Log
from sim_bridge.faults.flaw import Flaw
from sim_bridge.faults.live_logs import LiveLogs

LOST_MAX_NS = 20_000_000
"""Of the log, up to a fault."""
WHOLE_NS = 400_000_000
"""For how long before a fault the log is looked at; the robot has walked for longer."""
RETURNED_NS = 300_000_000
"""Before the end of a trial, by when ticks must be recorded again."""


def missing_log(
    logs: LiveLogs, at_ns: int, until_ns: int, period_ns: int, breaks_log: bool, ticks_on: bool = True
) -> list[Flaw]:
    """What a log lacks.

    Args:
        logs: of the trial.
        at_ns: when the fault struck.
        until_ns: until when the trial was watched.
        period_ns: of the fast loop.
        breaks_log: whether ticks are missing while the fault is there.
        ticks_on: whether control is to tick at the end.
    """
    ticks = logs.ticks(at_ns - WHOLE_NS, at_ns)
    if not len(ticks):
        return [Flaw("the log lacks the time before the fault", WHOLE_NS)]
    found = []
    missing = _missing_ticks(ticks)
    if missing:
        found.append(Flaw(f"{missing} ticks before the fault are missing", missing * period_ns))
    lost_ns = at_ns - int(ticks["now_ns"][-1])
    if lost_ns > LOST_MAX_NS:
        found.append(Flaw(f"the log lacks the last {lost_ns * 1e-6:.1f} ms before the fault", lost_ns))
    missing = _missing_ticks(logs.ticks(at_ns, until_ns))
    if missing and not breaks_log:
        found.append(Flaw(f"{missing} ticks after the fault are missing", missing * period_ns))
    if ticks_on and not len(logs.ticks(until_ns - RETURNED_NS, until_ns)):
        found.append(Flaw("nothing is recorded any more", RETURNED_NS))
    return found


def holes(log: Log) -> list[str]:
    """What the log of one walk lacks, from the first tick of each loop to the end."""
    found = [f"the log was cut off at {log.end_ns * 1e-9:.3f} s"] if log.truncated else []
    for topic in log.channels:
        if topic.startswith(TICK_TOPIC_PREFIX):
            ticks = log.read_signal(topic).values
            follows = np.diff(ticks["index"], prepend=-1) == 1 + ticks["skipped"]
            if not len(ticks) or not follows.all():
                loop = topic.removeprefix(TICK_TOPIC_PREFIX)
                found.append(f"ticks of {loop} are missing in the log at {len(follows) - int(follows.sum())} places")
    return found


def _missing_ticks(ticks: npt.NDArray[Any]) -> int:
    """Of those between the first and the last; what was skipped is not missing."""
    return int(np.maximum(np.diff(ticks["index"]) - 1 - ticks["skipped"][1:], 0).sum())
