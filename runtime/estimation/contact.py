# SPDX-License-Identifier: Apache-2.0
"""Which feet carry load, from joint efforts and gait phase: there are no foot sensors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.leg_kinematics import LegState

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def normal_force(legs: LegState, effort: Array, normal_base: Array) -> Array:
    """Ground reaction along the plane's normal, (4,), N, by statics: f = -J^-T tau.

    Args:
        legs: kinematics.
        effort: joint torques (12,), N.m.
        normal_base: normal of the ground in the base frame.
    """
    transposed = legs.jacobian.transpose(0, 2, 1) + 1e-6 * np.eye(3)
    force = -np.linalg.solve(transposed, effort.reshape(4, 3, 1))[:, :, 0]
    return np.asarray(force @ normal_base)


def loaded_feet(config: KalmanConfig, force: Array, stance: Mask, progress: Array) -> Mask:
    """Feet in contact: loaded ones scheduled to stand, and strongly loaded ones in the second half of their swing."""
    early = ~stance & (progress > 0.5) & (force > config.early_contact_force_n)
    return np.asarray((stance & (force > config.contact_force_n)) | early)


def rest_deviation(config: KalmanConfig, progress: Array) -> Array:
    """Standard deviation of a contact point's velocity over its stance: doubtful at both ends, m/s."""
    edge = np.minimum(progress, 1.0 - progress)
    doubt = np.clip(1.0 - edge / 0.15, 0.0, 1.0)
    return np.asarray(config.contact_velocity_mps + (config.landing_velocity_mps - config.contact_velocity_mps) * doubt)
