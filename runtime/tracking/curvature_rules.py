# SPDX-License-Identifier: Apache-2.0
"""Mamdani inference of a look-ahead distance from the curvature of the path (paper 002, Table I, completed).

Three curvatures, at the vehicle, 1.5 m and 3 m ahead, each small, middle or large, give a small, middle or large
distance. The printed table lacks (small, large, any); it is small, since the same bend 1.5 m ahead of a middle one is.
Rules combine by max-min; the result is the mean of one value per set, weighted by the sets' truth, which reaches the
whole range of the distance (a centroid would not).
"""

from __future__ import annotations

CURVATURE_AT_LIMIT = 0.4
"""Curvature at which the inputs saturate, 1/m."""

SMALL, MIDDLE, LARGE = 0, 1, 2

TABLE_I = (
    (SMALL, SMALL, SMALL, LARGE),
    (SMALL, SMALL, MIDDLE, MIDDLE),
    (SMALL, SMALL, LARGE, MIDDLE),
    (SMALL, MIDDLE, None, MIDDLE),
    (SMALL, LARGE, None, SMALL),  # not in print
    (LARGE, None, None, SMALL),
    (MIDDLE, SMALL, None, MIDDLE),
    (MIDDLE, MIDDLE, None, MIDDLE),
    (MIDDLE, LARGE, None, SMALL),
)
"""Sets of the curvatures at 0, 1.5 and 3 m (None: any), and that of the distance."""


def memberships(curvature: float) -> tuple[float, float, float]:
    """Truth of small, middle and large: uniform triangles on [0, 0.4] 1/m; the sign does not matter.

    Raises:
        ValueError: if the curvature is NaN.
    """
    if curvature != curvature:
        raise ValueError(f"fuzzy inference: curvature = {curvature} must not be NaN")
    x = min(2.0 * abs(curvature) / CURVATURE_AT_LIMIT, 2.0)
    return (1.0 - x, x, 0.0) if x < 1.0 else (0.0, 2.0 - x, x - 1.0)


def inferred_distance(here: float, near: float, far: float, distances: tuple[float, float, float]) -> float:
    """The look-ahead distance, m.

    Args:
        here: curvature of the path at the vehicle, 1/m.
        near: 1.5 m ahead.
        far: 3 m ahead.
        distances: what small, middle and large stand for, m.

    Raises:
        ValueError: if a curvature is NaN.
    """
    at_vehicle, ahead, beyond = memberships(here), memberships(near), memberships(far)
    truth = [0.0, 0.0, 0.0]
    for i, j, k, conclusion in TABLE_I:
        weight = at_vehicle[i]
        if j is not None:
            weight = min(weight, ahead[j])
        if k is not None:
            weight = min(weight, beyond[k])
        truth[conclusion] = max(truth[conclusion], weight)
    small, middle, large = truth
    return (small * distances[0] + middle * distances[1] + large * distances[2]) / (small + middle + large)
