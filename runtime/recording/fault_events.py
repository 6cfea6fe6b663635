# SPDX-License-Identifier: Apache-2.0
"""The faults of a run in real time, each with the stall that explains it.

A tick may be slow by its own thread's clock and yet not for what it computes: that clock goes on while a virtual
machine, another thread of the same core or cold memory hold a processor up. What no stall explains is therefore judged
once more, by what the tasks of the ticks before it need when they are stepped again on what they saw. Computing that is
slow by itself is so then too, and explains nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording import run_data
from runtime.recording.log import Log
from runtime.recording.stalls import Stall, StallBound, explanation, stalls_in
from runtime.safety.answers import HALTS, WARNINGS
from runtime.signals import Fault, Mode

Needs = Callable[[str, int, int], Mapping[int, int]]
"""Gives, by the index of each tick of a loop between two times, what its tasks need when stepped again, ns."""


class SlowTicks(NamedTuple):
    """Ticks before a fault that took their thread longer than their tasks need.

    Attributes:
        loop: whose.
        ticks: how many.
        took_ns: all together, by their thread's clock.
        need_ns: all together, stepped again.
    """

    loop: str
    ticks: int
    took_ns: int
    need_ns: int


class FaultEvent(NamedTuple):
    """A fall into DAMPED, or into the crouch before it, or a stand.

    Attributes:
        at_ns: when the tick began that found the fault.
        fault: bits.
        cause: the bit that was answered so; of several one that no stall explains, if there is one.
        bound: of a stall that may cause it, None if none can.
        stall: that explains it; None if none does.
        stalled_ns: for how long the loops of the bound were kept.
        slow: the ticks before it, if it took stepping them again to see the stall.
    """

    at_ns: int
    fault: Fault
    cause: Fault
    bound: StallBound | None
    stall: Stall | None
    stalled_ns: int
    slow: SlowTicks | None = None


def no_needs(loop: str, from_ns: int, to_ns: int) -> Mapping[int, int]:
    """Nothing can be stepped again."""
    return {}


def fault_events(
    log: Log, bounds: Sequence[StallBound], needs: Needs = no_needs
) -> tuple[list[FaultEvent], list[FaultEvent]]:
    """Every loss of power by a fault, and every pause of a robot on its way, with the stall that explains it.

    Args:
        log: of a run in real time.
        bounds: of the robot; a fault with several is explained by any, one without by nothing.
        needs: steps ticks of the log again.
    """
    names = sorted({loop for bound in bounds for loop in bound.loops if TICK_TOPIC_PREFIX + loop in log.channels})
    signals = log.read_signals([run_data.SAFETY, *(TICK_TOPIC_PREFIX + name for name in names)])
    ticks = {name: signals[TICK_TOPIC_PREFIX + name].values for name in names}
    stalls = [stall for name in names for stall in stalls_in(name, ticks[name])]
    status = signals[run_data.SAFETY].values

    def explained(fault: Fault, causes: Fault, at_ns: int) -> FaultEvent:
        event = judged(fault, causes, at_ns, bounds, stalls)
        if event.stall is not None or event.bound is None:
            return event
        return _judged_again(event, causes, bounds, stalls, ticks, needs)

    losses, pauses = [], []
    for row in _losses(status["mode"]):
        fault = Fault(int(status["fault"][row]) or int(status["warning"][row]))
        losses.append(explained(fault, taking_power(fault), int(status["stamp_ns"][row])))
    for row, bits in _pauses(status["mode"], status["halt"]):
        fault = Fault(bits)
        pauses.append(explained(fault, fault, int(status["stamp_ns"][row])))
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


def _judged_again(
    event: FaultEvent,
    causes: Fault,
    bounds: Sequence[StallBound],
    stalls: Sequence[Stall],
    ticks: Mapping[str, npt.NDArray[Any]],
    needs: Needs,
) -> FaultEvent:
    """Judge an event that no stall explains by what the ticks before it need."""
    concerned = [bound for bound in bounds if bound.fault & causes]
    from_ns = event.at_ns - max(bound.within_ns for bound in concerned)
    found, slow = list(stalls), None
    for loop in sorted({loop for bound in concerned for loop in bound.loops} & ticks.keys()):
        first, last = np.searchsorted(ticks[loop]["release_ns"], (from_ns, event.at_ns), side="right")
        before = ticks[loop][max(0, first - 1) : last].copy()  # the first was under way when the time began
        need_ns = needs(loop, int(before["release_ns"][0]), event.at_ns)
        took_ns = before["cpu_ns"].copy()
        before["cpu_ns"] = [min(took, need_ns.get(index, took)) for index, took in before[["index", "cpu_ns"]].tolist()]
        if again := stalls_in(loop, before):
            found += again
            rows = np.isin(before["release_ns"], [stall.at_ns for stall in again])
            slow = SlowTicks(loop, int(rows.sum()), int(took_ns[rows].sum()), int(before["cpu_ns"][rows].sum()))
    second = judged(event.fault, causes, event.at_ns, bounds, found)
    return second if second.stall is None else second._replace(slow=slow)


def _losses(mode: npt.NDArray[np.uint8]) -> list[int]:
    """Rows at which a robot crouches or is damped, be it before it stands."""
    lost = (mode == Mode.DAMPED) | (mode == Mode.CROUCHING)
    return [int(row) for row in np.flatnonzero(~lost[:-1] & lost[1:]) + 1]


def _pauses(mode: npt.NDArray[np.uint8], halt: npt.NDArray[np.uint32]) -> list[tuple[int, int]]:
    """Rows at which faults have a robot on its way stand, with their bits; where it stands already, the new ones."""
    begun = np.where(mode[1:] == Mode.ACTIVE, halt[1:] & ~halt[:-1], 0)
    return [(int(row) + 1, int(begun[row])) for row in np.flatnonzero(begun)]
