# SPDX-License-Identifier: Apache-2.0
"""Paths made of straights and arcs, and the courses of paper 002, as waypoints (n x 2 arrays, m)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from runtime.tracking.errors import PathError
from runtime.tracking.paths import Waypoints
from runtime.tracking.waypoints import check_cusped_waypoints, check_waypoints

WAYPOINT_SPACING_M = 0.3
CURVE_LENGTH_M = 40.0
CURVE_RADIUS_M = 2.5
"""Curvature 0.4 1/m, the largest that the paper's look-ahead knows."""


class Bend(NamedTuple):
    """A stretch of constant curvature.

    Attributes:
        length: m.
        curvature: 1/m, positive to the left.
    """

    length: float
    curvature: float = 0.0


def arc(angle_deg: float, radius_m: float = CURVE_RADIUS_M) -> Bend:
    """A bend by an angle, positive to the left."""
    return Bend(math.radians(abs(angle_deg)) * radius_m, math.copysign(1.0 / radius_m, angle_deg))


def path_of_bends(bends: Sequence[Bend], spacing_m: float = WAYPOINT_SPACING_M, source: str = "bends") -> Waypoints:
    """Waypoints on stretches joined smoothly, from the origin at yaw 0; the last one lies at the end.

    Raises:
        PathError: if a length or the spacing is not positive and finite.
    """
    for bend in bends:
        if not (math.isfinite(bend.length) and bend.length > 0.0 and math.isfinite(bend.curvature)):
            raise PathError(f"{source}: a length of {bend.length} m at curvature {bend.curvature} 1/m is no stretch")
    if not (math.isfinite(spacing_m) and spacing_m > 0.0):
        raise PathError(f"{source}: spacing = {spacing_m} m must be positive and finite")
    total = sum(bend.length for bend in bends)
    stations = np.linspace(0.0, total, max(round(total / spacing_m), 1) + 1)
    points = np.empty((len(stations), 2))
    x = y = heading = begin = 0.0
    for bend in bends:
        here = (stations >= begin - 1e-9) & (stations <= begin + bend.length + 1e-9)
        along = stations[here] - begin
        points[here] = np.column_stack(_advanced(x, y, heading, along, bend.curvature))
        ends = _advanced(x, y, heading, np.array([bend.length]), bend.curvature)
        x, y, heading = float(ends[0][0]), float(ends[1][0]), heading + bend.curvature * bend.length
        begin += bend.length
    return check_waypoints(points, source=source)


def path_of_strokes(
    strokes: Sequence[Sequence[Bend]], spacing_m: float = WAYPOINT_SPACING_M, source: str = "strokes"
) -> Waypoints:
    """Waypoints on strokes of bends that a vehicle drives forwards and backwards in turn, from the origin at yaw 0.

    Each stroke begins where the one before ends, and goes the opposite way: the path turns back there.

    Raises:
        PathError: see `path_of_bends`.
    """
    points = np.zeros((1, 2))
    heading = 0.0
    for stroke in strokes:
        cosine, sine = math.cos(heading), math.sin(heading)
        turned = path_of_bends(stroke, spacing_m, source) @ np.array([(cosine, sine), (-sine, cosine)])
        points = np.vstack((points, points[-1] + turned[1:]))
        heading += math.pi + sum(bend.length * bend.curvature for bend in stroke)
    return check_cusped_waypoints(points, source=source)


def _advanced(x: float, y: float, heading: float, along: Waypoints, curvature: float) -> tuple[Waypoints, Waypoints]:
    """Positions along a stretch that begins at (x, y)."""
    half = 0.5 * curvature * along
    chord = along * np.sinc(half / math.pi)
    return x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)


def _course(name: str, lead_in: float, *bends: Bend) -> Waypoints:
    """A course of 40 m: a straight, the bends, and a straight for the rest."""
    rest = CURVE_LENGTH_M - lead_in - sum(bend.length for bend in bends)
    return path_of_bends((Bend(lead_in), *bends, Bend(rest)), source=name)


def u_turn() -> Waypoints:
    """There, half round, and back."""
    return _course("u", 14.0, arc(180.0))


def s_bend() -> Waypoints:
    """Half round to the left, and half round to the right."""
    return _course("s", 10.0, arc(180.0), Bend(4.0), arc(-180.0))


def right_angle() -> Waypoints:
    """A quarter round to the left."""
    return _course("right-angle", 16.0, arc(90.0))


def loop() -> Waypoints:
    """Three quarters round to the left, and across the way in."""
    return _course("loop", 14.0, arc(270.0))


def chicane() -> Waypoints:
    """Aside by two bends of 60 degrees, and back."""
    return _course("chicane", 12.0, arc(60.0), arc(-60.0), Bend(4.0), arc(-60.0), arc(60.0))


CURVES = {"u": u_turn, "s": s_bend, "right-angle": right_angle, "loop": loop, "chicane": chicane}
"""The curve experiment's five shapes (the paper's own is unknown): 40 m, curvature at most 0.4 1/m."""


def figure_eight(size_m: float = 8.0, spacing_m: float = WAYPOINT_SPACING_M) -> Waypoints:
    """Bernoulli's lemniscate from its crossing, at yaw 45 degrees: one lap, a closed path.

    With a size of 8 m it is 42 m long and its least radius is 2.67 m.

    Raises:
        PathError: if the size or the spacing is not positive and finite, or the size below the spacing.
    """
    if not (math.isfinite(size_m) and math.isfinite(spacing_m) and 0.0 < spacing_m <= size_m):
        raise PathError(f"figure-eight: size = {size_m} m must be finite and at least the spacing of {spacing_m} m")
    turn = np.linspace(-0.5 * math.pi, 1.5 * math.pi, 20001)
    scale = size_m / (1.0 + np.sin(turn) ** 2)
    fine = np.column_stack((scale * np.cos(turn), -scale * np.sin(turn) * np.cos(turn)))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(fine, axis=0).T))))
    stations = np.linspace(0.0, along[-1], max(round(along[-1] / spacing_m), 8), endpoint=False)
    points = np.column_stack([np.interp(stations, along, fine[:, column]) for column in (0, 1)])
    return check_waypoints(points, closed=True, source="figure-eight")


def three_point_turn() -> Waypoints:
    """Half round to the left in three strokes of 60 degrees, and 1 m further back than it came."""
    third = arc(60.0)
    return path_of_strokes(((Bend(2.0), third), (third,), (third, Bend(3.0))), source="three-point-turn")
