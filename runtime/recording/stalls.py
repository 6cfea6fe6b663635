# SPDX-License-Identifier: Apache-2.0
"""Which stall of the machine stands before a fault: real time on a busy computer is judged by its own tick log."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording import run_data
from runtime.recording.log import Log
from runtime.signals import Fault, Mode

STALL_NS = 5_000_000
"""Shorter stalls are within the bounds of every input."""
LOOKBACK_NS = 250_000_000
"""How long before a fault its cause is looked for, beyond the bound itself."""


class Stall(NamedTuple):
    """Time in which a loop had work to do and was kept from it: late wakes, and steps that were interrupted.

    Attributes:
        loop: whose.
        at_ns: when the first of its ticks was due.
        length_ns: over that tick, and those that followed without the loop having caught up.
    """

    loop: str
    at_ns: int
    length_ns: int


class FaultEvent(NamedTuple):
    """A fall into DAMPED, or into the crouch before it.

    Attributes:
        at_ns: log time.
        fault: bits.
        stall: the longest stall beyond the bound in the time before it, None if there was none.
    """

    at_ns: int
    fault: Fault
    stall: Stall | None


def stalls_of(log: Log, loop: str, least_ns: int) -> list[Stall]:
    """Every stall of a loop of at least so long. A step's own computing is no stall, where it was measured."""
    topic = TICK_TOPIC_PREFIX + loop
    if topic not in log.channels:
        return []
    return stalls_in(loop, log.read_signal(topic).values, least_ns)


def stalls_in(loop: str, ticks: npt.NDArray[Any], least_ns: int) -> list[Stall]:
    """As `stalls_of`, from the loop's ticks in their order."""
    kept_ns = ticks["wake_latency_ns"] + ticks["compute_ns"] - ticks["cpu_ns"]
    caught_up = ticks["skipped"] == 0
    caught_up[:1] = True
    first = np.flatnonzero(caught_up)
    length = np.add.reduceat(kept_ns, first) if len(ticks) else kept_ns
    return [
        Stall(loop, int(ticks["release_ns"][row]), int(total))
        for row, total in zip(first, length, strict=True)
        if total >= least_ns
    ]


def fault_events(log: Log, least_ns: int, loops: tuple[str, ...] = ("wbc", "mpc", "link", "sim")) -> list[FaultEvent]:
    """Every loss of power by a fault, with the stall before it.

    Args:
        log: of a run in real time.
        least_ns: a shorter stall explains nothing.
        loops: whose stalls count.
    """
    safety = log.read_signal(run_data.SAFETY)
    mode = safety.values["mode"]
    stalls = [stall for loop in loops for stall in stalls_of(log, loop, least_ns)]
    events = []
    for row in _losses(mode):
        at_ns = int(safety.log_ns[row])
        before = [s for s in stalls if at_ns - LOOKBACK_NS <= s.at_ns + s.length_ns and s.at_ns <= at_ns]
        longest = max(before, key=lambda stall: stall.length_ns, default=None)
        bits = int(safety.values["fault"][row]) or int(safety.values["warning"][row])
        events.append(FaultEvent(at_ns, Fault(bits), longest))
    return events


def _losses(mode: npt.NDArray[np.uint8]) -> list[int]:
    """Rows at which a robot under power crouches or is damped."""
    powered = (mode == Mode.STANDING) | (mode == Mode.ACTIVE)
    lost = (mode == Mode.DAMPED) | (mode == Mode.CROUCHING)
    return [int(row) for row in np.flatnonzero(powered[:-1] & lost[1:]) + 1]
