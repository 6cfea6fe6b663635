# SPDX-License-Identifier: Apache-2.0
"""A path as a polyline: arc length, closest point, heading, look-ahead point."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import NamedTuple

import numpy.typing as npt

from runtime.models.rotations import wrapped
from runtime.tracking.waypoints import check_waypoints

CORNER_WIDTH_M = 0.1
"""Heading changes at a vertex are spread over at most this length of path."""


class ClosestPoint(NamedTuple):
    """Where on the path the robot is.

    Attributes:
        progress: arc length of the closest point, m.
        x, y: the closest point, m.
        heading: of the path there, rad.
        lateral_error: signed distance to the path's tangent, m; positive with the path to the right.
        distance: to the closest point, m.
    """

    progress: float
    x: float
    y: float
    heading: float
    lateral_error: float
    distance: float


class Polyline:
    """Waypoints joined by straight segments, in the plane.

    Beyond the goal an open path goes on straight along its final heading, and a closed path goes round again, so that
    a look-ahead point exists all the way to the goal.

    Args:
        points: waypoints, n x 2, m.
        closed: the last waypoint leads on to the first; the goal is then the first waypoint, after one lap.
        extension_m: how far the path goes on beyond the goal.

    Attributes:
        length: arc length from the first waypoint to the goal, m.
        closed: as given.

    Raises:
        PathError: see `check_waypoints`.
    """

    def __init__(self, points: npt.ArrayLike, closed: bool = False, extension_m: float = 10.0) -> None:
        waypoints = [(x, y) for x, y in check_waypoints(points, closed=closed).tolist()]
        if closed:
            waypoints.append(waypoints[0])
        self.closed = closed
        self._s = _arc_lengths(waypoints)
        self.length = self._s[-1]
        vertices = _go_round(waypoints, extension_m) if closed else _go_straight(waypoints, extension_m)
        self._s = _arc_lengths(vertices)
        self._goal_segment = len(waypoints) - 2
        self._x = [x for x, _ in vertices]
        self._y = [y for _, y in vertices]
        self._heading = _unwrapped_headings(vertices)
        self._spread = _spreads(self._s)

    @property
    def sections(self) -> tuple[Polyline, ...]:
        """Itself: a path that does not turn back has one section."""
        return (self,)

    @property
    def goal(self) -> tuple[float, float]:
        """Where the path ends, m."""
        return self._x[self._goal_segment + 1], self._y[self._goal_segment + 1]

    def _segment(self, s: float) -> int:
        return min(max(bisect_right(self._s, s) - 1, 0), len(self._heading) - 1)

    def point(self, s: float) -> tuple[float, float]:
        """The point at arc length `s`, m; extrapolated beyond both ends."""
        i = self._segment(s)
        along = s - self._s[i]
        share = along / (self._s[i + 1] - self._s[i])
        return self._x[i] + share * (self._x[i + 1] - self._x[i]), self._y[i] + share * (self._y[i + 1] - self._y[i])

    def heading(self, s: float) -> float:
        """Direction of the path at arc length `s`, rad, continuous: turns at vertices are spread along the path."""
        i = self._segment(s)
        turn, share = self._near_vertex(i, s)
        return wrapped(self._heading[i] + turn * share)

    def _near_vertex(self, i: int, s: float) -> tuple[float, float]:
        """The turn at the vertex whose spread contains `s`, and its share to add to the heading of segment `i`."""
        if i + 1 < len(self._heading) and self._s[i + 1] - s <= self._spread[i + 1]:
            width = self._spread[i + 1]
            return self._heading[i + 1] - self._heading[i], 0.5 * (s - self._s[i + 1] + width) / width
        if i > 0 and s - self._s[i] < self._spread[i]:
            width = self._spread[i]
            return self._heading[i] - self._heading[i - 1], 0.5 * (s - self._s[i] - width) / width
        return 0.0, 0.0

    def closest(self, x: float, y: float, start: float, window: float, beyond_goal: bool = False) -> ClosestPoint:
        """The point of the path closest to (x, y), searched forward only.

        Args:
            x: m.
            y: m.
            start: arc length to search from, m; the result is never less, so that arc length only grows.
            window: how far to search, m; short enough not to reach another pass of a path that crosses itself.
            beyond_goal: whether the closest point may lie on the extension beyond the goal.
        """
        last = self._s[-1] if beyond_goal else self.length
        start = min(max(start, 0.0), last)
        end = min(start + window, last)
        best_s, best_x, best_y = start, *self.point(start)
        best = _squared(x - best_x, y - best_y)
        i = self._segment(start)
        while i < len(self._heading) and self._s[i] <= end:
            x0, y0, s0 = self._x[i], self._y[i], self._s[i]
            span = self._s[i + 1] - s0
            ux, uy = (self._x[i + 1] - x0) / span, (self._y[i + 1] - y0) / span
            along = (x - x0) * ux + (y - y0) * uy
            along = min(max(along, start - s0, 0.0), span, end - s0)
            px, py = x0 + along * ux, y0 + along * uy
            squared = _squared(x - px, y - py)
            if squared < best:
                best, best_s, best_x, best_y = squared, s0 + along, px, py
            i += 1
        heading = self.heading(best_s)
        lateral = math.cos(heading) * (y - best_y) - math.sin(heading) * (x - best_x)
        return ClosestPoint(best_s, best_x, best_y, heading, lateral, math.sqrt(best))

    def look_ahead_point(self, x: float, y: float, progress: float, distance: float) -> tuple[float, float]:
        """Where the path beyond `progress` first leaves the circle of radius `distance` about (x, y), interpolated.

        Where the point at `progress` is itself outside the circle, there is no such point: the point `distance`
        further along the path then takes its place.

        Args:
            x: m.
            y: m.
            progress: arc length of the closest point, m.
            distance: look-ahead distance, m.
        """
        i, px, py = self._leaving(x, y, progress, distance)
        if i < 0:
            return self.point(progress + distance)
        return _leave_circle(px, py, self._x[i + 1], self._y[i + 1], x, y, distance)

    def look_ahead_progress(self, x: float, y: float, progress: float, distance: float) -> float:
        """Arc length of `look_ahead_point`, m."""
        i, px, py = self._leaving(x, y, progress, distance)
        if i < 0:
            return progress + distance
        px, py = _leave_circle(px, py, self._x[i + 1], self._y[i + 1], x, y, distance)
        return self._s[i] + math.hypot(px - self._x[i], py - self._y[i])

    def _leaving(self, x: float, y: float, progress: float, distance: float) -> tuple[int, float, float]:
        """The segment that leaves the circle and where on it to start, or -1 where none does."""
        px, py = self.point(progress)
        if _squared(px - x, py - y) >= distance * distance:
            return -1, px, py
        for i in range(self._segment(progress), len(self._heading)):
            ex, ey = self._x[i + 1], self._y[i + 1]
            if _squared(ex - x, ey - y) >= distance * distance:
                return i, px, py
            px, py = ex, ey
        return -1, px, py


def _leave_circle(px: float, py: float, ex: float, ey: float, x: float, y: float, radius: float) -> tuple[float, float]:
    """Intersection of the segment p-e with a circle that contains p and not e."""
    dx, dy = ex - px, ey - py
    fx, fy = px - x, py - y
    a = dx * dx + dy * dy
    b = fx * dx + fy * dy
    c = fx * fx + fy * fy - radius * radius
    share = (-b + math.sqrt(max(b * b - a * c, 0.0))) / a
    return px + share * dx, py + share * dy


def _arc_lengths(vertices: list[tuple[float, float]]) -> list[float]:
    total, lengths = 0.0, [0.0]
    for (x0, y0), (x1, y1) in pairwise(vertices):
        total += math.hypot(x1 - x0, y1 - y0)
        lengths.append(total)
    return lengths


def _unwrapped_headings(vertices: list[tuple[float, float]]) -> list[float]:
    headings: list[float] = []
    for (x0, y0), (x1, y1) in pairwise(vertices):
        heading = math.atan2(y1 - y0, x1 - x0)
        headings.append(headings[-1] + wrapped(heading - headings[-1]) if headings else heading)
    return headings


def _spreads(s: list[float]) -> list[float]:
    """Length on either side of each vertex over which its turn is spread, m."""
    inner = [min(b - a, c - b, CORNER_WIDTH_M) / 2.0 for a, b, c in zip(s, s[1:], s[2:], strict=False)]
    return [0.0, *inner, 0.0]


def _go_straight(waypoints: list[tuple[float, float]], extension: float) -> list[tuple[float, float]]:
    (x0, y0), (x1, y1) = waypoints[-2:]
    span = math.hypot(x1 - x0, y1 - y0)
    return [*waypoints, (x1 + extension * (x1 - x0) / span, y1 + extension * (y1 - y0) / span)]


def _go_round(lap: list[tuple[float, float]], extension: float) -> list[tuple[float, float]]:
    vertices, gone = list(lap), 0.0
    while gone < extension:
        for before, after in pairwise(lap):
            gone += math.hypot(after[0] - before[0], after[1] - before[1])
            vertices.append(after)
            if gone >= extension:
                break
    return vertices


def _squared(x: float, y: float) -> float:
    """Squared length of a vector; infinite, and no exception as of a power, where it is beyond all numbers."""
    return x * x + y * y
