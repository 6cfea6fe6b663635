# SPDX-License-Identifier: Apache-2.0
"""What a run against the wall clock shows that must not be, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from runtime.executors.resources import FILES_HELD

LONG_S = 600.0
"""From this duration on it is judged what processes hold; in shorter runs they still warm up."""
MEMORY_GROWTH_MAX = 0.02
LOCKED, TAKEN_MAX_BYTES = "control", 1 << 20
"""The process whose memory is locked: what it takes while its loops run is filled within a tick, 1 MiB in 2 ms."""

Faults = Sequence[Mapping[str, Any]]


def flaws(
    faults: Faults, pauses: Faults, ended_by: str, resources: Mapping[str, Any], duration_s: float | None
) -> list[str]:
    """Faults that no stall of the machine explains, and what processes of a long walk have kept.

    Args:
        faults: losses of power, each with its cause, the bound of a stall that may make it or None, and the stall that
            did or None.
        pauses: stands of a robot on its way, alike.
        ended_by: names of the fault that ended the run before its end; empty if none did.
        resources: by process, what it held when its loops had begun, early and late.
        duration_s: of a walk lap after lap; None for one scenario.
    """
    found = [f"power was lost to {_unexplained(fault)}" for fault in faults if fault["stall"] is None]
    found += [f"the robot paused for {_unexplained(fault)}" for fault in pauses if fault["stall"] is None]
    if ended_by and not faults:
        found.append(f"the robot never got to stand, and power was not lost: {ended_by}")
    if LOCKED in resources:
        found += _taken(resources[LOCKED]["begun"], resources[LOCKED]["late"])
    if duration_s is not None and duration_s >= LONG_S:
        for process, held in resources.items():
            found += _kept(process, held["early"], held["late"])
    return found


def _unexplained(fault: Mapping[str, Any]) -> str:
    if fault["bound"] is None:
        return f"{fault['cause']}, which no stall of a machine makes"
    loops, bound_ms = " or ".join(fault["bound"]["loops"]), fault["bound"]["ms"]
    beyond = f"without a stall of {loops} beyond {bound_ms:.3g} ms before it"
    return f"{fault['cause']} {beyond}, but of {fault['stalled_ms']:.3g} ms"


def _taken(begun: Mapping[str, int] | None, late: Mapping[str, int] | None) -> Iterator[str]:
    if begun is None or late is None:
        return
    taken = late["data_bytes"] - begun["data_bytes"]
    if taken >= TAKEN_MAX_BYTES:
        yield f"{LOCKED} took {taken / 1e6:.1f} MB of memory while its loops ran, and was held up filling it"


def _kept(process: str, early: Mapping[str, int] | None, late: Mapping[str, int] | None) -> Iterator[str]:
    if early is None or late is None:
        yield f"{process} was not there all the time"
        return
    for key, what in FILES_HELD.items():
        if late[key] > early[key]:
            yield f"{process} holds {late[key]} {what}, {early[key]} before"
    growth = late["resident_bytes"] / early["resident_bytes"] - 1.0
    if growth > MEMORY_GROWTH_MAX:
        yield f"{process} holds {100.0 * growth:.1f} % more memory than after two minutes"
