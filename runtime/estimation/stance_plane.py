# SPDX-License-Identifier: Apache-2.0
"""The plane through the points where the feet last stood, and the trunk's height above it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.models.rotations import normalized

Array = npt.NDArray[np.float64]

FLATNESS = 1e-3
"""Ridge on the slopes, m^2: with feet close together the plane falls back to level."""


@compiled
def center(stood: Array) -> tuple[float, float, float]:
    """Mean of four points (4, 3)."""
    x, y, z = 0.0, 0.0, 0.0
    for foot in range(4):
        x, y, z = x + stood[foot, 0], y + stood[foot, 1], z + stood[foot, 2]
    return 0.25 * x, 0.25 * y, 0.25 * z


@compiled
def plane_normal(stood: Array) -> Array:
    """Unit normal of the least-squares plane z = c + a x + b y through four points (4, 3)."""
    cx, cy, cz = center(stood)
    xx = yy = FLATNESS
    xy = xz = yz = 0.0
    for foot in range(4):
        dx, dy, dz = stood[foot, 0] - cx, stood[foot, 1] - cy, stood[foot, 2] - cz
        xx += dx * dx
        yy += dy * dy
        xy += dx * dy
        xz += dx * dz
        yz += dy * dz
    determinant = xx * yy - xy * xy
    a = (xz * yy - yz * xy) / determinant
    b = (yz * xx - xz * xy) / determinant
    scale = 1.0 / math.sqrt(a * a + b * b + 1.0)
    return np.array([-a * scale, -b * scale, scale])


@compiled
def smoothed(normal: Array, measured: Array, gain: float) -> Array:
    """First-order low-pass of a unit vector."""
    return normalized(normal + gain * (measured - normal))


@compiled
def height_above(position: Array, stood: Array, normal: Array, foot_radius: float) -> float:
    """Height along world z of a point above the contacts' plane with the given normal; `stood` are foot centres."""
    cx, cy, cz = center(stood)
    level = cz - (normal[0] * (position[0] - cx) + normal[1] * (position[1] - cy)) / normal[2]
    return float(position[2] - level + foot_radius / normal[2])
