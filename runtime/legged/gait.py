# SPDX-License-Identifier: Apache-2.0
"""The gait schedule: which feet are meant to stand at which time. Pure functions of time."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]

TROT_OFFSETS = (0.0, 0.5, 0.5, 0.0)
"""Phase by which each foot (LF, RF, LH, RH) is ahead: diagonal pairs move together."""


class GaitConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Timing of the trot.

    Attributes:
        period_ns: one gait cycle.
        stance_fraction: part of the cycle that each foot stands (duty factor).
    """

    period_ns: Annotated[int, msgspec.Meta(ge=200_000_000, le=1_000_000_000)] = 400_000_000
    stance_fraction: Annotated[float, msgspec.Meta(ge=0.5, le=0.8)] = 0.5

    @property
    def stance_s(self) -> float:
        """Duration of one stance."""
        return self.period_ns * self.stance_fraction * 1e-9

    @property
    def swing_s(self) -> float:
        """Duration of one swing."""
        return self.period_ns * (1.0 - self.stance_fraction) * 1e-9


@compiled
def foot_phases(config: GaitConfig, cycle_start_ns: int, now_ns: int) -> Array:
    """Phase of each of the four feet in its own cycle, in [0, 1), (4,); its stance begins at 0."""
    phase = ((now_ns - cycle_start_ns) % config.period_ns) / config.period_ns
    phases = np.empty(4)
    for foot in range(4):
        phases[foot] = (phase + TROT_OFFSETS[foot]) % 1.0
    return phases


@compiled
def scheduled_stance(config: GaitConfig, phases: Array) -> npt.NDArray[np.bool_]:
    """Which feet are meant to stand, (4,)."""
    return phases < config.stance_fraction


@compiled
def phase_progress(config: GaitConfig, phases: Array) -> Array:
    """Progress of each foot within its present stance or swing, 0 to 1, (4,)."""
    duty = config.stance_fraction
    return np.where(phases < duty, phases / duty, (phases - duty) / (1.0 - duty))


@compiled
def knots(config: GaitConfig, cycle_start_ns: int, begin_ns: int, steps: int) -> npt.NDArray[np.int64]:
    """Boundaries of `steps` steps of the horizon from `begin_ns` on, (steps + 1).

    The steps lie on the grid period / steps of the gait itself, so that a step never straddles a change of contacts
    when the stance fraction is a multiple of 1 / steps; the first step is what is left of the present one.
    """
    grid = config.period_ns // steps
    boundaries = np.empty(steps + 1, dtype=np.int64)
    boundaries[0] = begin_ns
    boundaries[1] = cycle_start_ns + ((begin_ns - cycle_start_ns) // grid + 1) * grid
    for step in range(1, steps):
        boundaries[step + 1] = boundaries[step] + grid
    return boundaries
