# SPDX-License-Identifier: Apache-2.0
"""Along the path by its own curvature, and back to it as fast as the steering can follow.

Seen from the path, the vehicle is at a lateral error e under a heading error psi, with its steering at a centre angle
delta that changes at a rate of at most r. Close to the path the law is linear. Further off, the vehicle heads for the
path at the steepest angle from which the steering can still straighten it in time: to turn by psi the steering needs
T = sqrt(2 L psi / (v r)), ramped up and down again, in which the vehicle comes nearer by v psi T / 2, so that

    psi(e) = (e / l)^(2/3),   l = sqrt(v L / (2 r)).

The centre angle that takes up a heading error in the same manner is sqrt(r L psi / v). Both are the time-optimal
profiles of their integrators; a margin on each keeps the cascade from overshooting. There is no look-ahead distance to
choose: the steering's rate sets the scale.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.models.rotations import wrapped
from runtime.tracking.curvature import mean_curvature
from runtime.tracking.motion import Motion
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.vehicle_answer import VehicleAnswer
from runtime.tracking.waypoint_pursuit import Pursuit

Positive = Annotated[float, Meta(gt=0.0, le=10.0)]
NEAREST_CENTRE = 0.2
"""Least distance from the centre of a bend, as a share of its radius, that the frame of the path is used at."""


class SteeredReturn(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="steered-return"):
    """Feed-forward of the path's curvature and a time-optimal return to it.

    Attributes:
        answer: of the steering.
        length_margin: factor on l.
        steering_share: factor on the angle that takes up a heading error.
        linear_offset_m: lateral error below which the heading is proportional to it.
        linear_heading_rad: heading error below which the steering is proportional to it.
        steepest_rad: greatest angle to the path.
        lead_s: the errors are taken this much later, at the present centre angle.
        maximum_curvature: bound on what is asked for, 1/m.
        span_m: length over which the path's curvature is taken, at least.
        span_s: the same as a time: a bend that begins at once takes the steering about this long.
        slowest_mps: speed below which the law is that at this speed.
    """

    answer: VehicleAnswer = VehicleAnswer()
    length_margin: Positive = 1.05
    steering_share: Positive = 1.2
    linear_offset_m: Positive = 0.16
    linear_heading_rad: Positive = 0.14
    steepest_rad: Annotated[float, Meta(gt=0.0, le=1.5)] = 1.2
    lead_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2
    maximum_curvature: Positive = 0.567
    span_m: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.6
    span_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.6
    slowest_mps: Positive = 0.2

    def __call__(self, path: Polyline, motion: Motion, closest: ClosestPoint) -> Pursuit:
        """The arc to drive."""
        speed = max(motion.speed, self.slowest_mps)
        span = max(self.span_m, self.span_s * speed)
        bend = mean_curvature(path, closest.progress, span)
        lateral, heading = closest.lateral_error, wrapped(motion.yaw - closest.heading)
        turning = self.answer.curvature_of(motion.angle) - bend
        heading += speed * turning * self.lead_s
        lateral += speed * self.lead_s * math.sin(heading - 0.5 * speed * turning * self.lead_s)
        correction = self.correction(lateral, heading, speed)
        ahead = mean_curvature(path, closest.progress + speed * self.lead_s, span)
        along = ahead * math.cos(heading) / max(1.0 - ahead * lateral, NEAREST_CENTRE)
        angle = self.answer.angle_of(along) + correction
        bound = self.answer.angle_of(self.maximum_curvature)
        curvature = self.answer.curvature_of(min(max(angle, -bound), bound))
        return Pursuit(curvature, (closest.x, closest.y), 0.0)

    def correction(self, lateral: float, heading: float, speed: float) -> float:
        """Centre angle besides that of the path, rad.

        Args:
            lateral: error, m, positive with the path to the right.
            heading: error, rad.
            speed: m/s.
        """
        rate, wheelbase = self.answer.rate_radps, self.answer.wheelbase_m
        steep, slope = self._descent(abs(lateral), speed)
        error = -math.copysign(steep, lateral) - heading
        size, linear = abs(error), self.linear_heading_rad
        share = self.steering_share * math.sqrt(rate * wheelbase / speed)
        taken_up = share * (math.sqrt(size) if size > linear else size / math.sqrt(linear))
        # the wanted heading turns as the vehicle comes nearer
        turn = -slope * speed * math.sin(heading)
        return math.copysign(taken_up, error) + math.atan(0.5 * wheelbase * turn / speed)

    def _descent(self, distance: float, speed: float) -> tuple[float, float]:
        """Angle at which to head for the path from a distance, rad, and its change with distance."""
        length = self.length_margin * math.sqrt(0.5 * speed * self.answer.wheelbase_m / self.answer.rate_radps)
        reference = max(distance, self.linear_offset_m)
        steep = (reference / length) ** (2.0 / 3.0)
        if distance <= self.linear_offset_m:
            slope = steep / reference
            steep = slope * distance
        else:
            slope = 2.0 / 3.0 * steep / reference
        return (steep, slope) if steep < self.steepest_rad else (self.steepest_rad, 0.0)
