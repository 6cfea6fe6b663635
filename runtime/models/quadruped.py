# SPDX-License-Identifier: Apache-2.0
"""What a quadruped with ab/ad, hip and knee joints is made of.

Feet are ordered left front, right front, left hind, right hind; joints ab/ad, hip, knee within each leg. Ab/ad turns
about +x, hip and knee about -y, so that a positive hip angle swings the leg forward (paper 000, eq 1
corrected).
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
Vector3 = tuple[float, float, float]

FEET = ("left_front", "right_front", "left_hind", "right_hind")
LEG_JOINTS = ("abad", "hip", "knee")
JOINT_NAMES = tuple(f"{foot}_{joint}" for foot in FEET for joint in LEG_JOINTS)
FORWARD = np.array([1.0, 1.0, -1.0, -1.0])
LEFT = np.array([1.0, -1.0, 1.0, -1.0])
AXES = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]])


class Link(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rigid link: mass, centre of mass in the link frame of a left leg, and the box of the same inertia."""

    mass_kg: Positive
    center_m: Vector3
    box_m: tuple[Positive, Positive, Positive]

    def inertia_kg_m2(self) -> Array:
        """Principal moments about the centre of mass, of a uniform box."""
        square = np.square(self.box_m)
        return self.mass_kg / 12.0 * (square.sum() - square)

    def center(self, left: float) -> Array:
        """Centre of mass in the link frame, mirrored for a right leg (`left` = -1)."""
        return np.array(self.center_m) * (1.0, left, 1.0)


class Quadruped(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Geometry and masses (paper 000, Table 4, completed)."""

    trunk: Link
    abad: Link
    thigh: Link
    shank: Link
    hip_x_m: Positive
    hip_y_m: Positive
    abad_length_m: Positive
    thigh_length_m: Positive
    shank_length_m: Positive
    foot_radius_m: Positive
    armature_kg_m2: NonNegative

    @property
    def mass_kg(self) -> float:
        """Total mass."""
        return self.trunk.mass_kg + 4 * (self.abad.mass_kg + self.thigh.mass_kg + self.shank.mass_kg)

    def hip_positions(self) -> Array:
        """Ab/ad joints in the base frame, (4, 3), m."""
        return np.stack((FORWARD * self.hip_x_m, LEFT * self.hip_y_m, np.zeros(4)), axis=1)

    def shoulder_positions(self) -> Array:
        """Points below which the feet stand at rest: hips moved out by the ab/ad link, (4, 3), m."""
        return self.hip_positions() + np.outer(LEFT, (0.0, self.abad_length_m, 0.0))

    def foot_position(self, leg: int, angles: Array) -> Array:
        """Foot centre in the base frame in closed form (paper 000, eq 1 corrected)."""
        s1, c1 = np.sin(angles[0]), np.cos(angles[0])
        s2, c2 = np.sin(angles[1]), np.cos(angles[1])
        s23, c23 = np.sin(angles[1] + angles[2]), np.cos(angles[1] + angles[2])
        reach = self.thigh_length_m * c2 + self.shank_length_m * c23
        lateral = LEFT[leg] * self.abad_length_m
        hip = self.hip_positions()[leg]
        return hip + np.array(
            [
                self.thigh_length_m * s2 + self.shank_length_m * s23,
                lateral * c1 + s1 * reach,
                lateral * s1 - c1 * reach,
            ]
        )

    def standing_angles(self, height_m: float) -> Array:
        """Joint angles (12,) with every foot below its shoulder and the trunk origin `height_m` above the contacts.

        Raises:
            ValueError: if the legs cannot reach that height.
        """
        length = height_m - self.foot_radius_m
        thigh, shank = self.thigh_length_m, self.shank_length_m
        if not abs(thigh - shank) < length < thigh + shank:
            raise ValueError(f"no joint angles put the trunk {height_m} m above the ground")
        knee = np.pi - np.arccos((thigh**2 + shank**2 - length**2) / (2 * thigh * shank))
        hip = -np.arctan2(shank * np.sin(knee), thigh + shank * np.cos(knee))
        return np.tile([0.0, hip, knee], 4)
