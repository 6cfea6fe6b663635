# SPDX-License-Identifier: Apache-2.0
"""The paths of paper 000 and their building blocks, as waypoints (n x 2 arrays, m, plan coordinates)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.tracking.errors import PathError
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.waypoints import check_waypoints

__all__ = [
    "ClosestPoint",
    "PathError",
    "Polyline",
    "SCurve",
    "check_waypoints",
    "circle",
    "line",
    "s_curve",
    "straight",
]

ARC_SPACING_M = 0.1

Waypoints = npt.NDArray[np.float64]


def line(start: tuple[float, float] = (0.0, 0.0), goal: tuple[float, float] = (10.0, 10.0)) -> Waypoints:
    """A straight line between two points; by default that of paper 000, section 5.1.

    Raises:
        PathError: if the points coincide or are not finite.
    """
    return check_waypoints([start, goal], source="line")


def straight(length_m: float, heading_rad: float = 0.0) -> Waypoints:
    """A straight line from the origin.

    Raises:
        PathError: if the length is not positive and finite.
    """
    if not (math.isfinite(length_m) and length_m > 0.0):
        raise PathError(f"straight: length = {length_m} m must be positive and finite")
    return check_waypoints(
        [(0.0, 0.0), (length_m * math.cos(heading_rad), length_m * math.sin(heading_rad))], source="straight"
    )


def circle(radius_m: float = 5.0, spacing_m: float = ARC_SPACING_M) -> Waypoints:
    """One lap about (0, R) from the origin at yaw 0, anticlockwise; a closed path, so the first point is not repeated.

    Raises:
        PathError: if the radius or the spacing is not positive and finite, or the radius below the spacing.
    """
    if not (math.isfinite(radius_m) and math.isfinite(spacing_m) and 0.0 < spacing_m <= radius_m):
        raise PathError(f"circle: radius = {radius_m} m must be finite and at least the spacing of {spacing_m} m")
    angles = np.linspace(0.0, math.tau, math.ceil(math.tau * radius_m / spacing_m), endpoint=False)
    points = np.column_stack((radius_m * np.sin(angles), radius_m * (1.0 - np.cos(angles))))
    return check_waypoints(points, closed=True, source="circle")


class SCurve(NamedTuple):
    """Plan lengths of the outdoor course of paper 000, section 5.2, and the angles of its slopes.

    It goes level, up a ramp, round a left half circle, straight, round a right half circle, down, and level.
    """

    level_in_m: float = 2.0
    climb_m: float = 4.0
    climb_deg: float = 15.0
    radius_m: float = 3.0
    straight_m: float = 2.0
    descent_m: float = 2.945
    descent_deg: float = 20.0
    level_out_m: float = 1.9

    @property
    def plateau_m(self) -> float:
        """Height of the top, m."""
        return self.climb_m * math.tan(math.radians(self.climb_deg))


def s_curve(course: SCurve | None = None, spacing_m: float = ARC_SPACING_M) -> Waypoints:
    """The S-curve from the origin at yaw 0, in plan coordinates: 31.7 m in plan, 32.0 m along the surface.

    Raises:
        PathError: if the geometry is degenerate.
    """
    course = course or SCurve()
    radius, top = course.radius_m, course.level_in_m + course.climb_m
    count = max(math.ceil(math.pi * radius / spacing_m), 2)
    angles = np.linspace(0.0, math.pi, count + 1)
    left = np.column_stack((top + radius * np.sin(angles), radius * (1.0 - np.cos(angles))))
    x1, y1 = top - course.straight_m, 2.0 * radius
    right = np.column_stack((x1 - radius * np.sin(angles), y1 + radius * (1.0 - np.cos(angles))))
    foot = x1 + course.descent_m
    end = [(foot, 4.0 * radius), (foot + course.level_out_m, 4.0 * radius)]
    return check_waypoints(np.vstack(([(0.0, 0.0), (course.level_in_m, 0.0)], left, right, end)), source="s-curve")
