# SPDX-License-Identifier: Apache-2.0
"""What each fault of a vehicle is answered with. Pure functions of the bits of `Fault`, and of a command's numbers.

A vehicle needs no balance: blind or not, it can always stop. It stops for good (DAMPED) by slowing all wheels alike, so
that it keeps to its bend; only if the steering of a wheel is stuck do the others turn parallel to it, since that is the
one direction in which all can roll, and straight.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.safety.answers import HALTS, WARNINGS
from runtime.safety.state_machine import Health
from runtime.signals import Fault, Motion, Stance

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

VEHICLE_HALTS = HALTS | Fault.TEMPERATURE.value
"""The vehicle slows to a stand, and goes on when they are gone; a hot motor cools best without work."""


@compiled
def vehicle_health(found: int) -> int:
    """Whether the vehicle may go on with the faults of this tick, or has to stop for good, as a number of `Health`."""
    return (Health.UNFIT if found & ~(WARNINGS | VEHICLE_HALTS) else Health.FIT).value


@compiled
def vehicle_stance(resting: bool, motion: int) -> int:
    """A number of `Stance`: a vehicle at rest of which nothing else is asked rests, any other stands."""
    idle = motion == Motion.REST or motion == Motion.SIT
    return (Stance.RESTING if resting and idle else Stance.STANDING).value


@compiled
def approached(present: Array, wanted: Array, step: float) -> Array:
    """All values on their way to others by the same share, none by more than a step, and none beyond."""
    furthest = np.abs(wanted - present).max()
    share = min(1.0, step / furthest) if furthest > 0.0 else 1.0
    return present + share * (wanted - present)


@compiled
def straight(steering: Array, measured: Array, speed: Array, stuck: Mask) -> Array:
    """Angles by which to stop: as they are, or parallel to those that are stuck if all wheels roll the same way.

    Args:
        steering: as commanded last, (n,), rad.
        measured: as they are.
        speed: of the wheels, as commanded last.
        stuck: wheels that cannot be steered.
    """
    angles = steering.copy()
    if stuck.any():
        alike = (speed >= 0.0).all() or (speed <= 0.0).all()
        total, count = 0.0, 0
        for wheel in range(stuck.shape[0]):
            if stuck[wheel] and math.isfinite(measured[wheel]):
                total, count = total + measured[wheel], count + 1
        for wheel in range(stuck.shape[0]):
            if stuck[wheel] and math.isfinite(measured[wheel]):
                angles[wheel] = measured[wheel]
            elif alike and count > 0:
                angles[wheel] = total / count
    return angles
