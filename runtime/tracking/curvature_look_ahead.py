# SPDX-License-Identifier: Apache-2.0
"""How far ahead to aim where the path bends: far on the straight, near in a bend and before it (paper 002, III.C)."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.tracking.curvature import mean_curvature
from runtime.tracking.curvature_rules import inferred_distance
from runtime.tracking.look_ahead import Distance
from runtime.tracking.polyline import Polyline

Preview = Annotated[float, Meta(ge=0.0, le=10.0)]


class CurvatureLookAhead(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="curvature"):
    """Table I on the curvature at the vehicle, 1.5 m and 3 m ahead.

    Attributes:
        small_m: the distance that small stands for.
        middle_m: that of middle.
        large_m: that of large.
        near_m: arc length to the second curvature.
        far_m: arc length to the third.
        span_m: length over which the curvature is taken; twice the paths' spacing of waypoints.
    """

    small_m: Distance = 0.6
    middle_m: Distance = 1.05
    large_m: Distance = 1.5
    near_m: Preview = 1.5
    far_m: Preview = 3.0
    span_m: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.6

    def __post_init__(self) -> None:
        """Check the distances against each other.

        Raises:
            ValueError: if they are not in order.
        """
        if not self.small_m <= self.middle_m <= self.large_m:
            raise ValueError(f"small_m, middle_m, large_m = {self.small_m}, {self.middle_m}, {self.large_m} must rise")
        if self.near_m > self.far_m:
            raise ValueError(f"near_m = {self.near_m} is above far_m = {self.far_m}")

    def along(self, path: Polyline, progress: float) -> float:
        """The distance, m, for a vehicle at an arc length of the path."""
        here, near, far = (mean_curvature(path, progress + s, self.span_m) for s in (0.0, self.near_m, self.far_m))
        return inferred_distance(here, near, far, (self.small_m, self.middle_m, self.large_m))
