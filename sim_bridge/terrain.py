# SPDX-License-Identifier: Apache-2.0
"""Terrain as height fields: flat, undulating, slopes, and the S-curve course."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.tracking.paths import SCurve

SPACING_M = 0.05
NODE_SPACING_M = 0.2
LEVEL_RADIUS_M = 0.6
BLEND_M = 0.2
MARGIN_M = 1.5

Array = npt.NDArray[np.float64]
Extent = tuple[float, float, float, float]
"""Least x, greatest x, least y, greatest y, in m."""


@dataclass(frozen=True)
class HeightField:
    """Heights on a regular grid, bilinear in between, level beyond the edges.

    Attributes:
        x_origin_m: x of the first column.
        y_origin_m: y of the first row.
        spacing_m: of the grid, the same in x and y.
        heights_m: rows along y, columns along x.

    Raises:
        ValueError: if the grid is smaller than 2 x 2, the spacing not positive, or a number not finite.
    """

    x_origin_m: float
    y_origin_m: float
    spacing_m: float
    heights_m: Array

    def __post_init__(self) -> None:
        """Check the grid."""
        if self.heights_m.ndim != 2 or min(self.heights_m.shape) < 2:
            raise ValueError(f"height field: the grid is {self.heights_m.shape}, at least 2 x 2 is needed")
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0.0):
            raise ValueError(f"height field: spacing = {self.spacing_m} m must be positive and finite")
        origin = math.isfinite(self.x_origin_m) and math.isfinite(self.y_origin_m)
        if not (origin and np.isfinite(self.heights_m).all()):
            raise ValueError("height field: origin and heights must be finite")

    @property
    def extent(self) -> Extent:
        """The ground that the grid covers."""
        rows, columns = self.heights_m.shape
        return (
            self.x_origin_m,
            self.x_origin_m + (columns - 1) * self.spacing_m,
            self.y_origin_m,
            self.y_origin_m + (rows - 1) * self.spacing_m,
        )

    @property
    def level(self) -> bool:
        """Whether all of it is at height zero."""
        return not self.heights_m.any()

    def height_at(self, x: float, y: float) -> float:
        """Height of the ground at one point, m."""
        return _height(self.heights_m, self.x_origin_m, self.y_origin_m, self.spacing_m, x, y)

    def height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Array:
        """Height of the ground at each point, m."""
        return np.vectorize(self.height_at, otypes=[np.float64])(x, y)

    def normal(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Array:
        """Upward unit normal of the ground at each point, last axis x, y, z."""
        slope = np.vectorize(self._slope_at, otypes=[np.float64, np.float64])
        slope_x, slope_y = slope(x, y)
        normal = np.stack((-slope_x, -slope_y, np.ones_like(slope_x)), axis=-1)
        return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))

    def _slope_at(self, x: float, y: float) -> tuple[float, float]:
        return _slope(self.heights_m, self.x_origin_m, self.y_origin_m, self.spacing_m, x, y)


@compiled
def _cell(
    heights: Array, x_origin: float, y_origin: float, spacing: float, x: float, y: float
) -> tuple[float, float, float, float, float, float]:
    """The four corner heights of the cell that a point lies in, and its place in it."""
    rows, columns = heights.shape
    u = min(max((x - x_origin) / spacing, 0.0), columns - 1.0)
    v = min(max((y - y_origin) / spacing, 0.0), rows - 1.0)
    i, j = min(int(u), columns - 2), min(int(v), rows - 2)
    return heights[j, i], heights[j, i + 1], heights[j + 1, i], heights[j + 1, i + 1], u - i, v - j


@compiled
def _height(heights: Array, x_origin: float, y_origin: float, spacing: float, x: float, y: float) -> float:
    a, b, c, d, u, v = _cell(heights, x_origin, y_origin, spacing, x, y)
    return (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v


@compiled
def _slope(heights: Array, x_origin: float, y_origin: float, spacing: float, x: float, y: float) -> tuple[float, float]:
    a, b, c, d, u, v = _cell(heights, x_origin, y_origin, spacing, x, y)
    return ((b - a) * (1.0 - v) + (d - c) * v) / spacing, ((c - a) * (1.0 - u) + (d - b) * u) / spacing


def extent_of(waypoints: npt.ArrayLike, margin_m: float = MARGIN_M) -> Extent:
    """The ground that a path needs."""
    points = np.asarray(waypoints, dtype=np.float64)
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return float(x0 - margin_m), float(x1 + margin_m), float(y0 - margin_m), float(y1 + margin_m)


def sampled(height: Callable[[Array, Array], Array], extent: Extent, spacing_m: float = SPACING_M) -> HeightField:
    """A height field from a vectorised function of x and y, on a grid that has a point at the origin."""
    x0, x1, y0, y1 = extent
    columns = np.arange(math.floor(x0 / spacing_m + 1e-9), math.ceil(x1 / spacing_m - 1e-9) + 1)
    rows = np.arange(math.floor(y0 / spacing_m + 1e-9), math.ceil(y1 / spacing_m - 1e-9) + 1)
    x, y = np.meshgrid(columns * spacing_m, rows * spacing_m)
    heights = np.broadcast_to(np.asarray(height(x, y), dtype=np.float64), x.shape).copy()
    return HeightField(float(x[0, 0]), float(y[0, 0]), spacing_m, heights)


def flat(extent: Extent) -> HeightField:
    """Level ground at height zero."""
    return sampled(lambda x, y: np.zeros_like(x), extent)


def undulation_nodes(amplitude_m: float, extent: Extent, seed: int) -> HeightField:
    """The random nodes: U(-A/2, A/2) from PCG64(seed), every 0.2 m; their RMS is A / sqrt(12).

    Args:
        amplitude_m: A, peak to peak.
        extent: the ground to cover.
        seed: of the generator.

    Raises:
        ValueError: if the amplitude is negative or not finite.
    """
    if not (math.isfinite(amplitude_m) and amplitude_m >= 0.0):
        raise ValueError(f"undulation: amplitude = {amplitude_m} m must be finite and not negative")
    grid = sampled(lambda x, y: np.zeros_like(x), extent, NODE_SPACING_M)
    rng = np.random.Generator(np.random.PCG64(seed))
    heights = rng.uniform(-amplitude_m / 2.0, amplitude_m / 2.0, grid.heights_m.shape)
    return HeightField(grid.x_origin_m, grid.y_origin_m, NODE_SPACING_M, heights)


def rising(distance: Array, width: float = BLEND_M) -> Array:
    """A weight that goes from 0 at a distance of zero to 1 at `width`."""
    return np.asarray(np.clip(distance / width, 0.0, 1.0))


def undulation(amplitude_m: float, extent: Extent, seed: int, start: tuple[float, float] = (0.0, 0.0)) -> HeightField:
    """Undulating ground, level within 0.6 m of the start and blended in over 0.2 m."""
    nodes = undulation_nodes(amplitude_m, extent, seed)
    return sampled(
        lambda x, y: nodes.height(x, y) * rising(np.hypot(x - start[0], y - start[1]) - LEVEL_RADIUS_M), extent
    )


def slope(angle_deg: float, extent: Extent, level_m: float = 1.0, slope_m: float = 4.0) -> HeightField:
    """Level ground, a slope along x, level ground; the same for every y.

    The lengths are plan lengths, as those of the S-curve are: 4 m in plan are 4.14 m along a surface of 15 degrees.

    Args:
        angle_deg: positive up.
        extent: the ground to cover.
        level_m: where the slope begins.
        slope_m: plan length of the slope.

    Raises:
        ValueError: if the angle is not within 45 degrees.
    """
    if not abs(angle_deg) <= 45.0:
        raise ValueError(f"slope: angle = {angle_deg} degrees is not within -45 to 45")
    grade = math.tan(math.radians(angle_deg))
    return sampled(lambda x, y: grade * np.clip(x - level_m, 0.0, slope_m), extent)


def s_curve_course(
    extent: Extent, seed: int, dirt_m: float = 0.045, course: SCurve | None = None, side_m: float = 1.0
) -> HeightField:
    """The ground under the S-curve: climb, plateau with dirt on the arcs, descent.

    Across the path the ground is level (but for the dirt), for 2 m on either side on the slopes; beyond that, where no
    path goes, a bank `side_m` wide joins either slope with the plateau, so that the whole field is continuous.

    Args:
        extent: the ground to cover.
        seed: of the dirt.
        dirt_m: undulation of the arcs, peak to peak.
        course: geometry.
        side_m: width of the banks.
    """
    course = course or SCurve()
    nodes = undulation_nodes(dirt_m, extent, seed)
    top = course.level_in_m + course.climb_m
    brow = top - course.straight_m
    climb = math.tan(math.radians(course.climb_deg))
    descent = math.tan(math.radians(course.descent_deg))
    plateau, width = course.plateau_m, 4.0 * course.radius_m
    lane = 2.0

    def height(x: Array, y: Array) -> Array:
        up = climb * np.clip(x - course.level_in_m, 0.0, course.climb_m)
        down = np.maximum(plateau - descent * np.clip(x - brow, 0.0, course.descent_m), 0.0)
        on_climb = 1.0 - rising(y - lane, side_m)
        on_descent = rising(y - (width - lane - side_m), side_m)
        ground = plateau + on_climb * (up - plateau) + on_descent * (down - plateau)
        middle = width / 2.0
        first = rising(x - top) * rising(middle + lane - y)
        second = rising(brow - x) * rising(y - (middle - lane))
        return np.asarray(ground + nodes.height(x, y) * np.maximum(first, second))

    return sampled(height, extent)
