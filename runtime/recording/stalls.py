# SPDX-License-Identifier: Apache-2.0
"""Which stall of the machine explains a fault: real time on a busy computer is judged by its own tick log.

A fault says that something was missing for a time. It is explained if, for as long as the fault's own bound says, that
time was filled by stalls of the loops that bring what was missing. Stalls of one loop, or of several that a message
passes through, count together wherever they come one after the other; where they lie beside each other, as when the
whole machine stands still, the time counts once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.companions import SIM
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording import run_data
from runtime.recording.log import Log
from runtime.safety.answers import HALTS, WARNINGS
from runtime.signals import Fault, Mode

STALL_NS = 1_000_000
"""For less than that loops wait on a machine at rest too."""
TOLD_LATE_NS = {SIM.name: SIM.period_ns}
"""A tick of the simulator tells the worst of the steps since the last one, and not when that was."""


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


class FaultEvent(NamedTuple):
    """A fall into DAMPED, or into the crouch before it, or a stand.

    Attributes:
        at_ns: when the tick began that found the fault.
        fault: bits.
        cause: the bit that was answered so; of several one that no stall explains, if there is one.
        bound: of a stall that may cause it, None if none can.
        stall: that explains it; None if none does.
        stalled_ns: for how long the loops of the bound were kept.
    """

    at_ns: int
    fault: Fault
    cause: Fault
    bound: StallBound | None
    stall: Stall | None
    stalled_ns: int


def stalls_of(log: Log, loop: str, least_ns: int = STALL_NS) -> list[Stall]:
    """Every stall of a loop of at least so long. A step's own computing is no stall, where it was measured."""
    topic = TICK_TOPIC_PREFIX + loop
    if topic not in log.channels:
        return []
    return stalls_in(loop, log.read_signal(topic).values, least_ns)


def stalls_in(loop: str, ticks: npt.NDArray[Any], least_ns: int = STALL_NS) -> list[Stall]:
    """As `stalls_of`, from the loop's ticks in their order.

    Periods that a tick made the loop skip have passed meanwhile, even if the wake and the step took less: it was kept
    while it read or sent.
    """
    kept_ns = ticks["wake_latency_ns"] + ticks["compute_ns"] - ticks["cpu_ns"]
    skipped = ticks["skipped"][1:].astype(np.int64)
    passed_ns = np.diff(ticks["release_ns"]) // (skipped + 1) * skipped - ticks["cpu_ns"][:-1]
    consecutive = np.diff(ticks["index"]) == skipped + 1
    kept_ns[:-1] = np.where(consecutive, np.maximum(kept_ns[:-1], passed_ns), kept_ns[:-1])
    return [
        Stall(loop, int(ticks["release_ns"][row]), int(kept_ns[row])) for row in np.flatnonzero(kept_ns >= least_ns)
    ]


def stalled_ns(stalls: Iterable[Stall], from_ns: int, until_ns: int) -> int:
    """For how much of a time at least one of the loops was kept from its work."""
    total_ns, reached_ns = 0, from_ns
    for begin_ns, end_ns in sorted(_placed(stall, until_ns) for stall in stalls):
        begin_ns, end_ns = max(begin_ns, reached_ns), min(end_ns, until_ns)
        if end_ns > begin_ns:
            total_ns, reached_ns = total_ns + end_ns - begin_ns, end_ns
    return total_ns


def _placed(stall: Stall, until_ns: int) -> tuple[int, int]:
    """Begin and end of a stall; where its tick does not tell them exactly, before a time if they may be."""
    earlier_ns = min(max(0, stall.at_ns + stall.length_ns - until_ns), TOLD_LATE_NS.get(stall.loop, 0))
    return stall.at_ns - earlier_ns, stall.at_ns - earlier_ns + stall.length_ns


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


def fault_events(log: Log, bounds: Sequence[StallBound]) -> tuple[list[FaultEvent], list[FaultEvent]]:
    """Every loss of power by a fault, and every pause of a robot on its way, with the stall that explains it.

    Args:
        log: of a run in real time.
        bounds: of the robot; a fault with several is explained by any, one without by nothing.
    """
    status = log.read_signal(run_data.SAFETY).values
    loops = sorted({loop for bound in bounds for loop in bound.loops})
    stalls = [stall for loop in loops for stall in stalls_of(log, loop)]
    losses, pauses = [], []
    for row in _losses(status["mode"]):
        fault = Fault(int(status["fault"][row]) or int(status["warning"][row]))
        losses.append(judged(fault, taking_power(fault), int(status["stamp_ns"][row]), bounds, stalls))
    for row in _pauses(status["mode"], status["halt"]):
        fault = Fault(int(status["halt"][row]))
        pauses.append(judged(fault, fault, int(status["stamp_ns"][row]), bounds, stalls))
    return losses, pauses


def judged(
    fault: Fault, causes: Fault, at_ns: int, bounds: Sequence[StallBound], stalls: Sequence[Stall]
) -> FaultEvent:
    """An event, explained if each of its causes is.

    Args:
        fault: bits.
        causes: those of them that count; if there is none, nothing explains the event.
        at_ns: when they were found.
        bounds: as for `fault_events`.
        stalls: of all loops.
    """
    bits = [Fault(1 << place) for place in range(int(causes).bit_length()) if int(causes) >> place & 1]
    found = [_judged_cause(fault, cause, at_ns, bounds, stalls) for cause in bits or [fault]]
    return next((event for event in found if event.stall is None), found[0])


def taking_power(fault: Fault) -> Fault:
    """Those bits of a fault that are not merely bridged, or answered by a stand."""
    return Fault(int(fault) & ~(WARNINGS | HALTS))


def _judged_cause(
    fault: Fault, cause: Fault, at_ns: int, bounds: Sequence[StallBound], stalls: Sequence[Stall]
) -> FaultEvent:
    tried = [(bound, *explanation(bound, stalls, at_ns)) for bound in bounds if bound.fault == cause]
    if not tried:
        return FaultEvent(at_ns, fault, cause, None, None, 0)
    bound, stall, kept_ns = max(tried, key=lambda one: one[2] - one[0].bound_ns)
    return FaultEvent(at_ns, fault, cause, bound, stall, kept_ns)


def _losses(mode: npt.NDArray[np.uint8]) -> list[int]:
    """Rows at which a robot under power crouches or is damped."""
    powered = (mode == Mode.STANDING) | (mode == Mode.ACTIVE)
    lost = (mode == Mode.DAMPED) | (mode == Mode.CROUCHING)
    return [int(row) for row in np.flatnonzero(powered[:-1] & lost[1:]) + 1]


def _pauses(mode: npt.NDArray[np.uint8], halt: npt.NDArray[np.uint32]) -> list[int]:
    """Rows at which a robot on its way is told to stand by a fault."""
    begins = (halt[1:] != 0) & (halt[:-1] == 0) & (mode[1:] == Mode.ACTIVE)
    return [int(row) for row in np.flatnonzero(begins) + 1]
