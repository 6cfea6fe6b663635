# SPDX-License-Identifier: Apache-2.0
"""Kinematics of the four legs in the trunk frame, in closed form (paper 000, eq 1 corrected)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.models.quadruped import FORWARD, LEFT, Quadruped

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
        self._robot = table_of(description)[0]
        self._hips, self._lateral = description.hip_positions(), LEFT * description.abad_length_m
        self._thigh, self._shank = description.thigh_length_m, description.shank_length_m

    def forward(self, angles: Array, rates: Array) -> LegState:
        """Feet at joint angles and rates (12,)."""
        return leg_state(self._robot, angles, rates)

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


@compiled
def leg_state(robot: Quadruped, angles: Array, rates: Array) -> LegState:
    """Feet at joint angles and rates (12,)."""
    thigh, shank = robot.thigh_length_m, robot.shank_length_m
    position, velocity, shank_rate = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    jacobian = np.empty((4, 3, 3))
    for leg in range(4):
        abad, hip, knee = angles[3 * leg], angles[3 * leg + 1], angles[3 * leg + 2]
        s1, c1 = math.sin(abad), math.cos(abad)
        shank_x, shank_z = shank * math.sin(hip + knee), shank * math.cos(hip + knee)
        x, reach = thigh * math.sin(hip) + shank_x, thigh * math.cos(hip) + shank_z
        lateral = LEFT[leg] * robot.abad_length_m
        y, z = lateral * c1 + s1 * reach, lateral * s1 - c1 * reach
        position[leg, 0], position[leg, 1] = FORWARD[leg] * robot.hip_x_m + x, LEFT[leg] * robot.hip_y_m + y
        position[leg, 2] = z
        rows = jacobian[leg]
        rows[0, 0], rows[0, 1], rows[0, 2] = 0.0, reach, shank_z
        rows[1, 0], rows[1, 1], rows[1, 2] = -z, -s1 * x, -s1 * shank_x
        rows[2, 0], rows[2, 1], rows[2, 2] = y, c1 * x, c1 * shank_x
        for axis in range(3):
            velocity[leg, axis] = 0.0
            for joint in range(3):
                velocity[leg, axis] += rows[axis, joint] * rates[3 * leg + joint]
        swing = rates[3 * leg + 1] + rates[3 * leg + 2]
        shank_rate[leg, 0], shank_rate[leg, 1], shank_rate[leg, 2] = rates[3 * leg], -c1 * swing, -s1 * swing
    return LegState(position, jacobian, velocity, shank_rate)


@compiled
def leg_drift(robot: Quadruped, angles: Array, rates: Array) -> tuple[Array, Array]:
    """What the trunk sees of its legs' accelerations while the joints keep their rates.

    Returns:
        Accelerations of the foot centres (4, 3), m/s^2, and angular ones of the shanks (4, 3), rad/s^2.
    """
    thigh, shank = robot.thigh_length_m, robot.shank_length_m
    foot, turning = np.empty((4, 3)), np.empty((4, 3))
    for leg in range(4):
        abad, hip, knee = angles[3 * leg], angles[3 * leg + 1], angles[3 * leg + 2]
        sway, thigh_rate, shank_rate = rates[3 * leg], rates[3 * leg + 1], rates[3 * leg + 1] + rates[3 * leg + 2]
        s1, c1 = math.sin(abad), math.cos(abad)
        thigh_x, thigh_z = thigh * math.sin(hip), thigh * math.cos(hip)
        shank_x, shank_z = shank * math.sin(hip + knee), shank * math.cos(hip + knee)
        lateral, reach = LEFT[leg] * robot.abad_length_m, thigh_z + shank_z
        closing = -thigh_x * thigh_rate - shank_x * shank_rate
        bending = -thigh_z * thigh_rate**2 - shank_z * shank_rate**2
        foot[leg, 0] = -thigh_x * thigh_rate**2 - shank_x * shank_rate**2
        foot[leg, 1] = -(lateral * c1 + s1 * reach) * sway**2 + 2.0 * c1 * sway * closing + s1 * bending
        foot[leg, 2] = -(lateral * s1 - c1 * reach) * sway**2 + 2.0 * s1 * sway * closing - c1 * bending
        turning[leg, 0] = 0.0
        turning[leg, 1], turning[leg, 2] = s1 * sway * shank_rate, -c1 * sway * shank_rate
    return foot, turning
