# SPDX-License-Identifier: Apache-2.0
"""Where and when the feet will push over the horizon. Pure functions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from runtime.legged.gait import GaitConfig, foot_phases, scheduled_stance
from runtime.models.rotations import rotation_z

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def stance_schedule(config: GaitConfig, cycle_start_ns: int, boundaries_ns: list[int]) -> Mask:
    """Feet that stand in each step of the horizon, (N, 4), by the gait at the steps' middles."""
    middles = [(begin + end) // 2 for begin, end in pairwise(boundaries_ns)]
    return np.array([scheduled_stance(config, foot_phases(config, cycle_start_ns, middle)) for middle in middles])


def contact_points(
    stance: Mask, foothold: Array, shoulder: Array, reference: Array, normal: Array, stance_s: float
) -> Array:
    """Foot centres over the horizon, (N, 4, 3), m, in odom.

    A foot stands where it stands, or lands where its swing is aimed at. A landing after that is below the shoulder at
    mid-stance of the reference motion, on the plane of the present footholds.

    Args:
        stance: schedule, (N, 4).
        foothold: where each foot stands or will land next, (4, 3), in odom.
        shoulder: points below which the feet stand at rest, in the base frame, (4, 3).
        reference: reference states, (N, 12).
        normal: of the stance plane.
        stance_s: duration of a stance.
    """
    steps = stance.shape[0]
    points = np.empty((steps, 4, 3))
    points[:] = foothold
    center = foothold.mean(axis=0)
    for foot in range(4):
        landing = _landing_after_next(stance[:, foot].tolist())
        if landing < steps:
            state = reference[landing]
            below = state[3:6] + 0.5 * stance_s * state[9:] + rotation_z(state[2]) @ (shoulder[foot] * (1.0, 1.0, 0.0))
            below[2] = center[2] - normal[:2] @ (below[:2] - center[:2]) / normal[2]
            points[landing:, foot] = below
    return points


def _landing_after_next(stands: list[bool]) -> int:
    """First step of a stance whose place is not yet known: a standing foot's first landing, another's second.

    The number of steps if there is none within the horizon.
    """
    step, known = 0, 1
    while step < len(stands):
        if stands[step] and (step == 0 or not stands[step - 1]):
            if known == 0:
                return step
            known -= 1
        step += 1
    return len(stands)


def nominal_centers(present: Array, reference: Array, durations: Array) -> Array:
    """Centre of mass at the middle of each step, (N, 3), if it catches up with its reference over the horizon.

    Args:
        present: centre of mass at the begin, (3,).
        reference: reference states, (N, 12).
        durations: of the steps, (N,), s.
    """
    begin = reference[0, 3:6] - reference[0, 9:] * durations[0]
    ends = np.concatenate((begin[None], reference[:, 3:6]))
    left = np.linspace(1.0, 0.0, durations.shape[0] + 1)[:-1]
    return np.asarray(0.5 * (ends[:-1] + ends[1:]) + np.outer(left, present - begin))
