# SPDX-License-Identifier: Apache-2.0
"""The curvature of a path of waypoints."""

from __future__ import annotations

from runtime.models.rotations import wrapped
from runtime.tracking.polyline import Polyline


def mean_curvature(path: Polyline, s: float, span_m: float) -> float:
    """Turn of the path over a stretch of length `span_m` about arc length `s`, per length, 1/m, positive to the left.

    Waypoints turn the path at once; over a stretch that is a multiple of their spacing the mean is that of the curve
    they lie on. Before the start and beyond an open path's goal the path is straight.
    """
    before, after = s - 0.5 * span_m, s + 0.5 * span_m
    return wrapped(path.heading(after) - path.heading(before)) / span_m


def curvatures_ahead(path: Polyline, s: float, spacing_m: float, count: int, span_m: float) -> list[float]:
    """Mean curvature at arc lengths `s`, `s` + spacing, ..., 1/m."""
    return [mean_curvature(path, s + spacing_m * station, span_m) for station in range(count)]
