# SPDX-License-Identifier: Apache-2.0
"""Who may move what: OFF -> STANDBY -> STANDING -> ACTIVE, and DAMPED from anywhere, by way of CROUCHING or at once."""

from __future__ import annotations

from enum import IntEnum

from runtime.compiled import compiled
from runtime.signals import Mode, Motion, Stance


class Health(IntEnum):
    """What is left of a robot with a fault."""

    FIT = 0
    BLIND = 1
    UNFIT = 2


@compiled
def next_mode(mode: int, health: int, armed: bool, reset: bool, motion: int, stance: int, walking: bool) -> int:
    """The state that follows, as a number of `Mode`.

    DAMPED is latched: leaving it takes a fit robot and an explicit reset with the arm withdrawn, then a new arm. A
    blind robot can no longer balance, but its joints obey: it crouches, whatever returns meanwhile, and is then damped.

    Args:
        mode: present state.
        health: by the faults of this tick; a robot whose crouching has lasted too long is unfit.
        armed: the operator holds the arm.
        reset: the operator asks to leave DAMPED.
        motion: what the operator asks for.
        stance: what the legs are doing.
        walking: whether the gait steps.
    """
    if mode == Mode.DAMPED:
        return (Mode.STANDBY if health == Health.FIT and reset and not armed else Mode.DAMPED).value
    if mode == Mode.OFF:
        return (Mode.STANDBY if health == Health.FIT else Mode.OFF).value
    if mode == Mode.CROUCHING:
        ended = health == Health.UNFIT or not armed or stance == Stance.RESTING
        return (Mode.DAMPED if ended else Mode.CROUCHING).value
    if health == Health.BLIND and armed and mode != Mode.STANDBY and stance != Stance.RESTING:
        return Mode.CROUCHING.value
    if health != Health.FIT:
        return Mode.DAMPED.value
    if mode == Mode.STANDBY:
        rises = armed and (motion == Motion.STAND or motion == Motion.WALK)
        return (Mode.STANDING if rises else Mode.STANDBY).value
    resting = stance == Stance.RESTING and (motion == Motion.REST or motion == Motion.SIT)
    if not armed or (mode == Mode.STANDING and resting):
        return (Mode.STANDBY if resting else Mode.DAMPED).value
    if mode == Mode.STANDING and motion == Motion.WALK and stance == Stance.STANDING:
        return Mode.ACTIVE.value
    if mode == Mode.ACTIVE and motion != Motion.WALK and not walking:
        return Mode.STANDING.value
    return int(mode)
