# SPDX-License-Identifier: Apache-2.0
"""Kinematics of the four legs in the trunk frame, in closed form and all legs at once (paper 000, eq 1 corrected)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.models.quadruped import LEFT, Quadruped

Array = npt.NDArray[np.float64]


class LegState(NamedTuple):
    """Feet in the trunk frame, one row a leg.

    Attributes:
        position: foot centres, (4, 3), m.
        jacobian: d position / d leg angles, (4, 3, 3).
        velocity: of the foot centres relative to the trunk, (4, 3), m/s.
        shank_rate: angular velocity of the shanks relative to the trunk, (4, 3), rad/s.
    """

    position: Array
    jacobian: Array
    velocity: Array
    shank_rate: Array


class LegKinematics:
    """Forward and inverse kinematics of a quadruped's legs."""

    def __init__(self, description: Quadruped) -> None:
        self._hips = description.hip_positions()
        self._lateral = LEFT * description.abad_length_m
        self._thigh, self._shank = description.thigh_length_m, description.shank_length_m

    def forward(self, angles: Array, rates: Array) -> LegState:
        """Feet at joint angles and rates (12,)."""
        q, dq = angles.reshape(4, 3), rates.reshape(4, 3)
        pitch = q[:, 1] + q[:, 2]
        sine, cosine = np.sin(q), np.cos(q)
        s1, c1 = sine[:, 0], cosine[:, 0]
        shank_x, shank_z = self._shank * np.sin(pitch), self._shank * np.cos(pitch)
        x = self._thigh * sine[:, 1] + shank_x
        reach = self._thigh * cosine[:, 1] + shank_z
        position = np.empty((4, 3))
        position[:, 0] = x
        position[:, 1] = self._lateral * c1 + s1 * reach
        position[:, 2] = self._lateral * s1 - c1 * reach
        jacobian = np.empty((4, 3, 3))
        jacobian[:, 0, 0] = 0.0
        jacobian[:, 1, 0] = -position[:, 2]
        jacobian[:, 2, 0] = position[:, 1]
        jacobian[:, 0, 1] = reach
        jacobian[:, 1, 1] = -s1 * x
        jacobian[:, 2, 1] = c1 * x
        jacobian[:, 0, 2] = shank_z
        jacobian[:, 1, 2] = -s1 * shank_x
        jacobian[:, 2, 2] = c1 * shank_x
        velocity = np.matmul(jacobian, dq[:, :, None])[:, :, 0]
        swing = dq[:, 1] + dq[:, 2]
        shank_rate = np.empty((4, 3))
        shank_rate[:, 0] = dq[:, 0]
        shank_rate[:, 1] = -c1 * swing
        shank_rate[:, 2] = -s1 * swing
        position += self._hips
        return LegState(position, jacobian, velocity, shank_rate)

    def inverse(self, feet: Array) -> Array:
        """Joint angles (12,) that put the foot centres at `feet` (4, 3); out-of-reach points are drawn to the nearest reach."""
        local = feet - self._hips
        radius = np.maximum(np.hypot(local[:, 1], local[:, 2]), np.abs(self._lateral) + 1e-6)
        reach = np.sqrt(radius**2 - self._lateral**2)
        abad = np.arctan2(local[:, 1], -local[:, 2]) - np.arctan2(self._lateral, reach)
        x = local[:, 0]
        span = np.hypot(x, reach)
        limit = self._thigh + self._shank - 1e-6
        scale = np.minimum(1.0, limit / span)
        x, reach, span = x * scale, reach * scale, span * scale
        cosine = (span**2 - self._thigh**2 - self._shank**2) / (2 * self._thigh * self._shank)
        knee = np.arccos(np.clip(cosine, -1.0, 1.0))
        hip = np.arctan2(x, reach) - np.arctan2(self._shank * np.sin(knee), self._thigh + self._shank * np.cos(knee))
        return np.stack((abad, hip, knee), axis=1).ravel()
