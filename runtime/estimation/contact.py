# SPDX-License-Identifier: Apache-2.0
"""Which feet carry load, from joint efforts and gait phase: there are no foot sensors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_kinematics import LegState
from runtime.models.vectors import cross, dot, solve_three

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

EDGE = 0.15
"""Part of a stance, at its begin and end, in which the foot may still or already slip."""
SINGULAR_M3 = 2e-3
"""Determinant of a leg's Jacobian below which it is taken for singular (knee bent by 0.15 rad)."""


@compiled
def normal_force(legs: LegState, effort: Array, normal_base: Array) -> Array:
    """Ground reaction along the plane's normal of each foot, (4,), N: n . f with f = -J^-T tau.

    A leg near its singular reach, whose torques say nothing of it, gives zero.

    Args:
        legs: kinematics.
        effort: joint torques less those that move the legs themselves, (12,), N.m.
        normal_base: normal of the ground in the base frame.
    """
    force = np.zeros(4)
    for leg in range(4):
        jacobian, torque = legs.jacobian[leg], effort[3 * leg : 3 * leg + 3]
        volume = dot(jacobian[:, 0], cross(jacobian[:, 1], jacobian[:, 2]))
        if abs(volume) >= SINGULAR_M3:
            # n . J^-T tau = tau . J^-1 n
            force[leg] = -dot(torque, solve_three(jacobian, normal_base))
    return force


@compiled
def loaded_feet(config: KalmanConfig, force: Array, stance: Mask, progress: Array) -> Mask:
    """Feet in contact: loaded ones scheduled to stand, and strongly loaded ones in the second half of their swing."""
    loaded = np.empty(4, dtype=np.bool_)
    for foot in range(4):
        threshold = config.contact_force_n if stance[foot] else config.early_contact_force_n
        loaded[foot] = force[foot] > threshold and (stance[foot] or progress[foot] > 0.5)
    return loaded


@compiled
def rest_deviation(config: KalmanConfig, progress: Array) -> Array:
    """Standard deviation of each contact point's velocity over its stance (n,): doubtful at both ends, m/s."""
    deviation = np.empty(progress.shape[0])
    for foot in range(progress.shape[0]):
        edge = min(progress[foot], 1.0 - progress[foot])
        doubt = max(0.0, 1.0 - edge / EDGE)
        deviation[foot] = config.contact_velocity_mps
        deviation[foot] += (config.landing_velocity_mps - config.contact_velocity_mps) * doubt
    return deviation
