# SPDX-License-Identifier: Apache-2.0
"""Pure pursuit of waypoints, plain or with the longitudinal distance constraint (paper 002, section III)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from runtime.tracking.curvature_look_ahead import CurvatureLookAhead
from runtime.tracking.longitudinal import pursued_progress, pursued_waypoint
from runtime.tracking.look_ahead import FixedLookAhead
from runtime.tracking.motion import Motion
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.pure_pursuit import pursuit_curvature

Gain = Annotated[float, Meta(ge=0.0, le=5.0)]
Spacing = Annotated[float, Meta(ge=0.0, le=2.0)]


class Pursuit(NamedTuple):
    """What a pursuit asks for.

    Attributes:
        curvature: of the arc to drive, 1/m, positive to the left.
        target: the point that the arc meets, m.
        look_ahead: L_a that was asked for, m.
    """

    curvature: float
    target: tuple[float, float]
    look_ahead: float


class WaypointPursuit(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="pursuit"):
    """The arc through the look-ahead point (eq 6, with the actual distance to the point that was chosen).

    The paper's plain pure pursuit has a fixed look-ahead and no gain; its own method has the gain, on the straight with
    a fixed look-ahead and on curves with that of Table I.

    Attributes:
        look_ahead: policy of the look-ahead distance L_a.
        longitudinal_gain: K_r of eq 11, 0 for none.
        waypoint_spacing_m: the point is chosen among waypoints this far apart; 0: anywhere on the path.
    """

    look_ahead: FixedLookAhead | CurvatureLookAhead = FixedLookAhead(1.5)
    longitudinal_gain: Gain = 0.0
    waypoint_spacing_m: Spacing = 0.3

    def __call__(self, path: Polyline, motion: Motion, closest: ClosestPoint) -> Pursuit:
        """The arc from where the vehicle is; the closest point of the path is known."""
        x, y, yaw = motion[:3]
        distance, gain = self.look_ahead.along(path, closest.progress), self.longitudinal_gain
        spacing = self.waypoint_spacing_m
        if spacing > 0.0:
            progress = pursued_waypoint(path, x, y, closest, distance, gain, spacing)
        else:
            progress = pursued_progress(path, x, y, closest, distance, gain)
        target = path.point(progress)
        return Pursuit(pursuit_curvature(x, y, yaw, target), target, distance)
