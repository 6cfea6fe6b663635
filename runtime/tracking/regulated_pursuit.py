# SPDX-License-Identifier: Apache-2.0
"""Regulated pure pursuit, a peer for comparison (Macenski, Singh, Martin, Gines, Autonomous Robots 2023).

From its published description: the look-ahead distance is the speed times a look-ahead time, within bounds; the point
is interpolated on the path; the speed is reduced in proportion to the radius of the arc where that is below a least
radius, and in proportion to the distance to the goal close to it; it never falls below a least speed.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.tracking.longitudinal import pursued_progress
from runtime.tracking.look_ahead import Distance
from runtime.tracking.motion import Motion
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.pure_pursuit import pursuit_curvature
from runtime.tracking.waypoint_pursuit import Pursuit

Positive = Annotated[float, Meta(gt=0.0, le=10.0)]


class RegulatedPursuit(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="regulated"):
    """Look-ahead by speed; the defaults are those that Nav2 documents.

    Attributes:
        look_ahead_s: time to look ahead.
        minimum_m: least look-ahead distance.
        maximum_m: greatest.
    """

    look_ahead_s: Positive = 1.5
    minimum_m: Distance = 0.3
    maximum_m: Distance = 0.9

    def __post_init__(self) -> None:
        """Check the bounds against each other.

        Raises:
            ValueError: if they cross.
        """
        if self.minimum_m > self.maximum_m:
            raise ValueError(f"minimum_m = {self.minimum_m} is above maximum_m = {self.maximum_m}")

    def __call__(self, path: Polyline, motion: Motion, closest: ClosestPoint) -> Pursuit:
        """The arc to drive."""
        distance = min(max(self.look_ahead_s * abs(motion.speed), self.minimum_m), self.maximum_m)
        x, y, yaw = motion[:3]
        target = path.point(pursued_progress(path, x, y, closest, distance, 0.0))
        return Pursuit(pursuit_curvature(x, y, yaw, target), target, distance)


class RegulatedSpeed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Speed by curvature and by the distance to the goal; the defaults are those that Nav2 documents.

    Attributes:
        least_radius_m: radius of the arc below which the speed falls.
        least_mps: what a bend never reduces the speed below.
        approach_m: distance to the goal below which the speed falls.
        approach_least_mps: what the approach never reduces the speed below.
    """

    least_radius_m: Positive = 0.9
    least_mps: Positive = 0.25
    approach_m: Positive = 0.6
    approach_least_mps: Positive = 0.05

    def __call__(
        self, path: Polyline, curvature: float, progress: float, remaining: float, wanted: float, grip: float = 1.0
    ) -> float:
        """The speed, m/s; as published it does not ask for the grip."""
        tightness = abs(curvature) * self.least_radius_m
        regulated = max(wanted / max(tightness, 1.0), min(wanted, self.least_mps))
        return min(regulated, max(wanted * remaining / self.approach_m, self.approach_least_mps))
