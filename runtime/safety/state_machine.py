# SPDX-License-Identifier: Apache-2.0
"""Who may move what: OFF -> STANDBY -> STANDING -> ACTIVE, and DAMPED from anywhere."""

from __future__ import annotations

from runtime.signals import Mode, Motion, Stance


def next_mode(mode: Mode, healthy: bool, armed: bool, reset: bool, motion: Motion, stance: Stance) -> Mode:
    """The state that follows.

    DAMPED is latched: leaving it takes a healthy robot and an explicit reset with the arm withdrawn, then a new arm.

    Args:
        mode: present state.
        healthy: no fault in this tick.
        armed: the operator holds the arm.
        reset: the operator asks to leave DAMPED.
        motion: what the operator asks for.
        stance: what the legs are doing.
    """
    if mode == Mode.DAMPED:
        return Mode.STANDBY if healthy and reset and not armed else Mode.DAMPED
    if mode == Mode.OFF:
        return Mode.STANDBY if healthy else Mode.OFF
    if not healthy:
        return Mode.DAMPED
    if mode == Mode.STANDBY:
        return Mode.STANDING if armed and motion in (Motion.STAND, Motion.WALK) else Mode.STANDBY
    resting = stance == Stance.RESTING and motion in (Motion.REST, Motion.SIT)
    if not armed or (mode == Mode.STANDING and resting):
        return Mode.STANDBY if resting else Mode.DAMPED
    if mode == Mode.STANDING and motion == Motion.WALK and stance == Stance.STANDING:
        return Mode.ACTIVE
    if mode == Mode.ACTIVE and motion != Motion.WALK:
        return Mode.STANDING
    return mode
