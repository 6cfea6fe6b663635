# SPDX-License-Identifier: Apache-2.0
"""Where and when the feet will push over the horizon. Pure functions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.legged.gait import GaitConfig, foot_phases, scheduled_stance

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@compiled
def stance_schedule(config: GaitConfig, cycle_start_ns: int, boundaries_ns: npt.NDArray[np.int64]) -> Mask:
    """Feet that stand in each step of the horizon, (N, 4), by the gait at the steps' middles."""
    steps = boundaries_ns.shape[0] - 1
    stance = np.empty((steps, 4), dtype=np.bool_)
    for step in range(steps):
        middle_ns = (boundaries_ns[step] + boundaries_ns[step + 1]) // 2
        stance[step] = scheduled_stance(config, foot_phases(config, cycle_start_ns, middle_ns))
    return stance


@compiled
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
    points = np.empty((*stance.shape, 3))
    points[:] = foothold
    center = 0.25 * foothold.sum(axis=0)
    for foot in range(4):
        landing = _landing_after_next(stance[:, foot])
        for step in range(landing, stance.shape[0]):
            state = reference[landing]
            cosine, sine = math.cos(state[2]), math.sin(state[2])
            x = state[3] + 0.5 * stance_s * state[9] + cosine * shoulder[foot, 0] - sine * shoulder[foot, 1]
            y = state[4] + 0.5 * stance_s * state[10] + sine * shoulder[foot, 0] + cosine * shoulder[foot, 1]
            drop = (normal[0] * (x - center[0]) + normal[1] * (y - center[1])) / normal[2]
            points[step, foot, 0], points[step, foot, 1], points[step, foot, 2] = x, y, center[2] - drop
    return points


@compiled
def _landing_after_next(stands: Mask) -> int:
    """First step of a stance whose place is not yet known: a standing foot's first landing, another's second.

    The number of steps if there is none within the horizon.
    """
    known = 1
    for step in range(stands.shape[0]):
        if stands[step] and (step == 0 or not stands[step - 1]):
            if known == 0:
                return step
            known -= 1
    return stands.shape[0]


@compiled
def nominal_centers(present: Array, reference: Array, durations: Array) -> Array:
    """Centre of mass at the middle of each step, (N, 3), if it catches up with its reference over the horizon.

    Args:
        present: centre of mass at the begin, (3,).
        reference: reference states, (N, 12).
        durations: of the steps, (N,), s.
    """
    steps = durations.shape[0]
    centers, before = np.empty((steps, 3)), reference[0, 3:6] - reference[0, 9:] * durations[0]
    behind = present - before
    for step in range(steps):
        after = reference[step, 3:6]
        centers[step] = 0.5 * (before + after) + (1.0 - step / steps) * behind
        before = after
    return centers
