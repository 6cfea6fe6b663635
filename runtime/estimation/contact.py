# SPDX-License-Identifier: Apache-2.0
"""Which feet carry load, from joint efforts and gait phase: there are no foot sensors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_kinematics import LegState

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

EDGE = 0.15
"""Part of a stance, at its begin and end, in which the foot may still or already slip."""
SINGULAR_M3 = 2e-3
"""Determinant of a leg's Jacobian below which it is taken for singular (knee bent by 0.15 rad)."""


def normal_force(legs: LegState, effort: Array, normal_base: Array) -> list[float]:
    """Ground reaction along the plane's normal of each foot, N: n . f with f = -J^-T tau.

    A leg near its singular reach, whose torques say nothing of it, gives zero.

    Args:
        legs: kinematics.
        effort: joint torques less those that move the legs themselves, (12,), N.m.
        normal_base: normal of the ground in the base frame.
    """
    nx, ny, nz = normal_base.tolist()
    torque = effort.tolist()
    forces = []
    for leg, ((a, b, c), (d, e, f), (g, h, i)) in enumerate(legs.jacobian.tolist()):
        # J^-1 n by cofactors; n . J^-T tau = tau . J^-1 n
        determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        if abs(determinant) < SINGULAR_M3:
            forces.append(0.0)
            continue
        x = (e * i - f * h) * nx + (c * h - b * i) * ny + (b * f - c * e) * nz
        y = (f * g - d * i) * nx + (a * i - c * g) * ny + (c * d - a * f) * nz
        z = (d * h - e * g) * nx + (b * g - a * h) * ny + (a * e - b * d) * nz
        t0, t1, t2 = torque[3 * leg : 3 * leg + 3]
        forces.append(-(t0 * x + t1 * y + t2 * z) / determinant)
    return forces


def loaded_feet(config: KalmanConfig, force: Array, stance: Mask, progress: Array) -> Mask:
    """Feet in contact: loaded ones scheduled to stand, and strongly loaded ones in the second half of their swing."""
    threshold = np.where(stance, config.contact_force_n, config.early_contact_force_n)
    return np.asarray((force > threshold) & (stance | (progress > 0.5)))


def rest_deviation(config: KalmanConfig, progress: float) -> float:
    """Standard deviation of a contact point's velocity over its stance: doubtful at both ends, m/s."""
    edge = min(progress, 1.0 - progress)
    doubt = max(0.0, 1.0 - edge / EDGE)
    return config.contact_velocity_mps + (config.landing_velocity_mps - config.contact_velocity_mps) * doubt
