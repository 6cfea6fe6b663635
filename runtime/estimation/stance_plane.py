# SPDX-License-Identifier: Apache-2.0
"""The plane through the points where the feet last stood, and the trunk's height above it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FLATNESS = 1e-3
"""Ridge on the slopes, m^2: with feet close together the plane falls back to level."""


def plane_normal(stood: Array) -> Array:
    """Unit normal (3,) of the least-squares plane z = c + a x + b y through the points (4, 3)."""
    centered = stood - stood.mean(axis=0)
    x, y, z = centered.T
    xx, yy, xy = float(x @ x) + FLATNESS, float(y @ y) + FLATNESS, float(x @ y)
    xz, yz = float(x @ z), float(y @ z)
    determinant = xx * yy - xy * xy
    a = (xz * yy - yz * xy) / determinant
    b = (yz * xx - xz * xy) / determinant
    scale = 1.0 / math.sqrt(a * a + b * b + 1.0)
    return np.array([-a * scale, -b * scale, scale])


def smoothed(normal: Array, measured: Array, gain: float) -> Array:
    """First-order low-pass of a unit vector."""
    mixed = normal + gain * (measured - normal)
    return np.asarray(mixed / math.sqrt(float(mixed @ mixed)))


def height_above(position: Array, stood: Array, normal: Array, foot_radius: float) -> float:
    """Height along world z of a point above the contacts' plane with the given normal; `stood` are foot centres."""
    center = stood.mean(axis=0)
    slope_x, slope_y = normal[0] / normal[2], normal[1] / normal[2]
    level = center[2] - slope_x * (position[0] - center[0]) - slope_y * (position[1] - center[1])
    return float(position[2] - level + foot_radius / normal[2])
