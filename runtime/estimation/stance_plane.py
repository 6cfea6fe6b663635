# SPDX-License-Identifier: Apache-2.0
"""The plane through the points where the feet last stood, and the trunk's height above it."""

from __future__ import annotations

import math
from collections.abc import Sequence

Point = Sequence[float]

FLATNESS = 1e-3
"""Ridge on the slopes, m^2: with feet close together the plane falls back to level."""


def center(stood: Sequence[Point]) -> tuple[float, float, float]:
    """Mean of four points."""
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = stood
    return 0.25 * (x0 + x1 + x2 + x3), 0.25 * (y0 + y1 + y2 + y3), 0.25 * (z0 + z1 + z2 + z3)


def plane_normal(stood: Sequence[Point]) -> tuple[float, float, float]:
    """Unit normal of the least-squares plane z = c + a x + b y through four points."""
    cx, cy, cz = center(stood)
    xx = yy = FLATNESS
    xy = xz = yz = 0.0
    for x, y, z in stood:
        dx, dy, dz = x - cx, y - cy, z - cz
        xx += dx * dx
        yy += dy * dy
        xy += dx * dy
        xz += dx * dz
        yz += dy * dz
    determinant = xx * yy - xy * xy
    a = (xz * yy - yz * xy) / determinant
    b = (yz * xx - xz * xy) / determinant
    scale = 1.0 / math.sqrt(a * a + b * b + 1.0)
    return -a * scale, -b * scale, scale


def smoothed(normal: Point, measured: Point, gain: float) -> tuple[float, float, float]:
    """First-order low-pass of a unit vector."""
    x, y, z = (old + gain * (new - old) for old, new in zip(normal, measured, strict=True))
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


def height_above(position: Point, stood: Sequence[Point], normal: Point, foot_radius: float) -> float:
    """Height along world z of a point above the contacts' plane with the given normal; `stood` are foot centres."""
    cx, cy, cz = center(stood)
    nx, ny, nz = normal
    level = cz - (nx * (position[0] - cx) + ny * (position[1] - cy)) / nz
    return position[2] - level + foot_radius / nz
