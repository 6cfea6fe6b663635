# SPDX-License-Identifier: Apache-2.0
"""Which point of the path to pursue: look-ahead distance and longitudinal distance constraint (paper 002, section III).

Two constraints hold together: the point is at least the look-ahead distance L_a from the vehicle, and at least the
longitudinal distance L_r = K_r d from the point of the path closest to the vehicle (LDC, eq 11), where d is the
distance to that. The first bounds how sharply a vehicle on the path steers, the second how steeply one beside it
returns. Where the path is out of reach (d > L_a) the first constraint has no intersection: the point L_a further along
the path than the closest one then takes its place.
"""

from __future__ import annotations

import math

from runtime.tracking.polyline import ClosestPoint, Polyline

SLACK_M = 1e-9
WINDING = 4
"""A path that has not got away over this many times the distance is taken as it is."""


def pursued_progress(
    path: Polyline, x: float, y: float, closest: ClosestPoint, look_ahead: float, longitudinal_gain: float
) -> float:
    """Arc length of the first point of the path that meets both constraints, m, interpolated.

    Args:
        path: the path.
        x: of the vehicle, m.
        y: of the vehicle, m.
        closest: the path's point closest to it.
        look_ahead: L_a, m.
        longitudinal_gain: K_r; 0 leaves the second constraint out.
    """
    at_distance = path.look_ahead_progress(x, y, closest.progress, look_ahead)
    longitudinal = longitudinal_gain * closest.distance
    if longitudinal <= 0.0:
        return at_distance
    return max(at_distance, path.look_ahead_progress(closest.x, closest.y, closest.progress, longitudinal))


def pursued_waypoint(
    path: Polyline,
    x: float,
    y: float,
    closest: ClosestPoint,
    look_ahead: float,
    longitudinal_gain: float,
    spacing_m: float,
) -> float:
    """Arc length of the first waypoint that meets both constraints, m: the paper's choice from a discrete set.

    Args:
        path: the path.
        x: of the vehicle, m.
        y: of the vehicle, m.
        closest: the path's point closest to it; the waypoint nearest that is the first that counts.
        look_ahead: L_a, m.
        longitudinal_gain: K_r; 0 leaves the second constraint out.
        spacing_m: arc length between waypoints.
    """
    nearest = round(closest.progress / spacing_m)
    nearest_x, nearest_y = path.point(nearest * spacing_m)
    index = nearest
    if closest.distance > look_ahead + SLACK_M:
        index += math.ceil(look_ahead / spacing_m - SLACK_M)
    longitudinal = longitudinal_gain * closest.distance
    furthest = index + math.ceil((look_ahead + longitudinal) / spacing_m) * WINDING
    while index < furthest:
        px, py = path.point(index * spacing_m)
        if (
            math.hypot(px - x, py - y) >= look_ahead - SLACK_M
            and math.hypot(px - nearest_x, py - nearest_y) >= longitudinal - SLACK_M
        ):
            break
        index += 1
    return index * spacing_m
