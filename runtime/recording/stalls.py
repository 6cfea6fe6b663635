# SPDX-License-Identifier: Apache-2.0
"""Which stalls a loop had, and whether they fill the bound of a fault: real time is judged by its own tick log.

A fault says that something was missing for a time. It is explained if, for as long as the fault's own bound says, that
time was filled by stalls of the loops that bring what was missing. Stalls of one loop, or of several that a message
passes through, count together wherever they come one after the other; where they lie beside each other, as when the
whole machine stands still, the time counts once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.signals import Fault

STALL_NS = 1_000_000
"""For less than that loops wait on a machine at rest too."""


class Stall(NamedTuple):
    """Time in which a loop had work to do and was kept from it: by a late wake, or in a step that was interrupted.

    Attributes:
        loop: whose.
        at_ns: when its tick was due.
        length_ns: for how long it was kept.
    """

    loop: str
    at_ns: int
    length_ns: int


class StallBound(NamedTuple):
    """What a stall must be beyond to be the cause of a fault.

    Attributes:
        fault: one bit.
        loops: that the machine must have kept from their work,
        bound_ns: for longer than this
        within_ns: of the time up to the fault.
    """

    fault: Fault
    loops: tuple[str, ...]
    bound_ns: int
    within_ns: int


def stalls_in(loop: str, ticks: npt.NDArray[Any], least_ns: int = STALL_NS) -> list[Stall]:
    """Every stall of a loop of at least so long, from its ticks in their order.

    Where a loop measures its own computing, that is no stall, and periods that a tick made it skip have passed even if
    its wake and its step took less: it was kept while it read or sent.
    """
    kept_ns = ticks["wake_latency_ns"] + ticks["compute_ns"] - ticks["cpu_ns"]
    skipped = ticks["skipped"][1:].astype(np.int64)
    passed_ns = np.diff(ticks["release_ns"]) // (skipped + 1) * skipped - ticks["cpu_ns"][:-1]
    consecutive = (np.diff(ticks["index"]) == skipped + 1) & (ticks["cpu_ns"][:-1] > 0)
    kept_ns[:-1] = np.where(consecutive, np.maximum(kept_ns[:-1], passed_ns), kept_ns[:-1])
    return [
        Stall(loop, int(ticks["release_ns"][row]), int(kept_ns[row])) for row in np.flatnonzero(kept_ns >= least_ns)
    ]


def stalled_ns(stalls: Iterable[Stall], from_ns: int, until_ns: int) -> int:
    """For how much of a time at least one of the loops was kept from its work."""
    total_ns, reached_ns = 0, from_ns
    for begin_ns, end_ns in sorted((stall.at_ns, stall.at_ns + stall.length_ns) for stall in stalls):
        begin_ns, end_ns = max(begin_ns, reached_ns), min(end_ns, until_ns)
        if end_ns > begin_ns:
            total_ns, reached_ns = total_ns + end_ns - begin_ns, end_ns
    return total_ns


def explanation(bound: StallBound, stalls: Iterable[Stall], at_ns: int) -> tuple[Stall | None, int]:
    """The stall beyond a bound before a fault, if there is one, and for how long the bound's loops were kept.

    Returns:
        The longest of the stalls, no shorter than all that count together; None if they are not beyond the bound.
    """
    from_ns = at_ns - bound.within_ns
    counting = [stall for stall in stalls if stall.loop in bound.loops]
    kept_ns = stalled_ns(counting, from_ns, at_ns)
    if kept_ns <= bound.bound_ns:
        return None, kept_ns
    longest = max(counting, key=lambda stall: stalled_ns((stall,), from_ns, at_ns))
    return longest._replace(length_ns=max(longest.length_ns, kept_ns)), kept_ns
