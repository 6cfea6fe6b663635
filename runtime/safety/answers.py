# SPDX-License-Identifier: Apache-2.0
"""What each fault is answered with. Pure functions of the bits of `Fault`."""

from __future__ import annotations

from runtime.compiled import compiled
from runtime.safety.config import SafetyConfig
from runtime.safety.state_machine import Health
from runtime.signals import Fault, Mode

WARNINGS = (
    Fault.NON_FINITE_SENSOR | Fault.IMPLAUSIBLE_IMU | Fault.IMU_TIME | Fault.MISSING_REPLY | Fault.LATE_FORCES
).value
"""Bridged and counted."""
HALTS = (
    Fault.STALE_LOCALIZATION
    | Fault.MOVED_LOCALIZATION
    | Fault.STALE_BODY_COMMAND
    | Fault.STALE_OPERATOR
    | Fault.NO_LEASE
    | Fault.STALE_FORCES
    | Fault.LATE_LOOP
).value
"""The robot slows to a stand, and goes on when they are gone."""
BLINDING = (Fault.STALE_IMU | Fault.FROZEN_IMU).value
"""The trunk is no longer known, so that the robot crouches before it is damped."""


def derating_faults(config: SafetyConfig) -> int:
    """Faults that first lower the bound of torques, as configured."""
    choices = {
        Fault.MOTOR_FAULT: config.motor_fault,
        Fault.TEMPERATURE: config.temperature,
        Fault.VOLTAGE: config.voltage,
        Fault.SATURATION: config.saturation,
    }
    return sum(fault.value for fault, answer in choices.items() if answer == "derate")


@compiled
def is_powered(mode: int) -> bool:
    """Whether the joints are under power in a state."""
    return mode == Mode.STANDING or mode == Mode.ACTIVE or mode == Mode.CROUCHING


@compiled
def is_down(mode: int) -> bool:
    """Whether a state is one that a fault leads to."""
    return mode == Mode.CROUCHING or mode == Mode.DAMPED


@compiled
def health_of(found: int, mode: int, tolerated: int) -> int:
    """What is left of a robot, as a number of `Health`.

    Args:
        found: faults of this tick.
        mode: present state; while it crouches, the trunk's tilt is not known.
        tolerated: faults that it is derated for and has not been for too long.
    """
    passed_over = WARNINGS | HALTS | tolerated
    if mode == Mode.CROUCHING:
        passed_over |= BLINDING | Fault.TILT.value
    serious = found & ~passed_over
    if serious & ~BLINDING:
        return Health.UNFIT.value
    return (Health.BLIND if serious else Health.FIT).value
