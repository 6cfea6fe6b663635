# SPDX-License-Identifier: Apache-2.0
"""What the report says of safety."""

from __future__ import annotations

import numpy as np

from runtime.recording import run_data
from runtime.recording.run_data import RunData
from runtime.signals import Fault, Mode

_MOST_TOLD = 12
"""Of the moments at which a robot was damped."""


def safety_warnings(data: RunData) -> list[str]:
    """When the robot was damped, and what was found in how many ticks."""
    safety = data.signals.get(run_data.SAFETY)
    if safety is None:
        return []
    said = []
    is_damped = safety.values["mode"] == Mode.DAMPED
    begins = np.flatnonzero(is_damped & ~np.concatenate([[False], is_damped[:-1]]))
    for row in begins[:_MOST_TOLD]:
        at_s, fault = safety.log_ns[row] / 1e9, int(safety.values["fault"][row])
        said.append(f"The robot was damped at {at_s:.2f} s: {_fault_names(fault)}.")
    if len(begins) > _MOST_TOLD:
        said.append(f"It was damped {_counted(len(begins) - _MOST_TOLD, 'time')} more.")
    on = safety.values["mode"] != Mode.OFF
    for bit in Fault:
        hit = np.flatnonzero(on & (safety.values["warning"] & int(bit) != 0))
        if bit and len(hit):
            name, ticks = _fault_names(int(bit)), _counted(len(hit), "tick")
            said.append(f"Warning of {name} in {ticks}, first at {safety.log_ns[hit[0]] / 1e9:.2f} s.")
    return said


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _fault_names(bits: int) -> str:
    names = [bit.name.lower().replace("_", " ") for bit in Fault if bit and bits & int(bit) and bit.name]
    return ", ".join(names) if names else "no fault named"
