# SPDX-License-Identifier: Apache-2.0
"""Kinematics of the four legs in the trunk frame, in closed form (paper 000, eq 1 corrected).

Written in plain numbers: for matrices this small that is several times faster than array operations.
"""

from __future__ import annotations

from math import cos, sin
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
        self._roots = [(*hip, side) for hip, side in zip(self._hips.tolist(), self._lateral.tolist(), strict=True)]

    def forward(self, angles: Array, rates: Array) -> LegState:
        """Feet at joint angles and rates (12,)."""
        q, dq = angles.tolist(), rates.tolist()
        numbers = []
        for leg, root in enumerate(self._roots):
            numbers.append(self._leg(root, *q[3 * leg : 3 * leg + 3], *dq[3 * leg : 3 * leg + 3]))
        table = np.array(numbers)
        return LegState(table[:, :3], table[:, 3:12].reshape(4, 3, 3), table[:, 12:15], table[:, 15:])

    def _leg(
        self,
        root: tuple[float, float, float, float],
        abad: float,
        hip: float,
        knee: float,
        abad_rate: float,
        hip_rate: float,
        knee_rate: float,
    ) -> tuple[float, ...]:
        """One leg: position, row-major Jacobian, velocity and shank rate, 18 numbers."""
        root_x, root_y, root_z, lateral = root
        pitch = hip + knee
        s1, c1 = sin(abad), cos(abad)
        shank_x, shank_z = self._shank * sin(pitch), self._shank * cos(pitch)
        x = self._thigh * sin(hip) + shank_x
        reach = self._thigh * cos(hip) + shank_z
        y, z = lateral * c1 + s1 * reach, lateral * s1 - c1 * reach
        j11, j12 = -s1 * x, -s1 * shank_x
        j21, j22 = c1 * x, c1 * shank_x
        swing = hip_rate + knee_rate
        return (
            root_x + x,
            root_y + y,
            root_z + z,
            0.0,
            reach,
            shank_z,
            -z,
            j11,
            j12,
            y,
            j21,
            j22,
            reach * hip_rate + shank_z * knee_rate,
            -z * abad_rate + j11 * hip_rate + j12 * knee_rate,
            y * abad_rate + j21 * hip_rate + j22 * knee_rate,
            abad_rate,
            -c1 * swing,
            -s1 * swing,
        )

    def inverse(self, feet: Array) -> Array:
        """Joint angles (12,) that put the foot centres at `feet` (4, 3), drawn in where they are out of reach."""
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
