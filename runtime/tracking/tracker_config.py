# SPDX-License-Identifier: Apache-2.0
"""Parameters of the tracker, and what it remembers."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.records import boolean, float64, int64
from runtime.tracking.followed_path import FollowedPathMemory
from runtime.tracking.look_ahead import FixedLookAhead, FuzzyLookAhead
from runtime.tracking.speed import TrimmedSpeed
from runtime.tracking.turn import TurnLimits
from runtime.tracking.velocity import VelocityLimits

Seconds = Annotated[float, Meta(gt=0.0, le=10.0)]


class TrackerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the tracker.

    Attributes:
        look_ahead: the look-ahead policy.
        speed: limits of speed and yaw rate.
        turn: when and how to turn in place.
        velocity: limits of a velocity that the operator asks for instead.
        search_window_m: how far ahead of the last progress the closest point is searched.
        start_window_m: the same when a path is new; a path is run from its start.
        error_filter_s: time constant of the filtered derivative ec of the lateral error.
        drift_filter_s: time constant of the angle between heading and course.
        drift_limit_rad: bound on that angle.
        drift_minimum_mps: course speed below which the course is not trusted.
        course_lag_s: age of the average behind `BodyState.course_velocity`: its time constant.
        longest_step_s: a longer gap between steps counts as this.
    """

    look_ahead: FixedLookAhead | FuzzyLookAhead = msgspec.field(default_factory=FuzzyLookAhead)
    speed: TrimmedSpeed = msgspec.field(default_factory=TrimmedSpeed)
    turn: TurnLimits = msgspec.field(default_factory=TurnLimits)
    velocity: VelocityLimits = msgspec.field(default_factory=VelocityLimits)
    search_window_m: Annotated[float, Meta(ge=0.1, le=5.0)] = 0.6
    start_window_m: Annotated[float, Meta(ge=0.1, le=10.0)] = 1.5
    error_filter_s: Seconds = 0.5
    drift_filter_s: Seconds = 1.0
    drift_limit_rad: Annotated[float, Meta(ge=0.0, le=0.8)] = 0.2
    drift_minimum_mps: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.15
    course_lag_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2
    longest_step_s: Seconds = 0.1


class TrackerState(FollowedPathMemory):
    """All that the tracker remembers, the path it follows included."""

    stamp_ns = int64("ns", "of the last step, 0 before the first")
    arrived = boolean()
    turning = boolean("in place")
    oriented = boolean("the heading to hold is known")
    progress = float64("m")
    error_magnitude = float64("m", "filtered magnitude of the lateral error")
    drift = float64("rad", "filtered angle from heading to course")
    speed = float64("m/s", "ramped, before the trim")
    lateral = float64("m/s", "ramped")
    yaw_rate = float64("rad/s", "ramped")
    trim = float64("", "share added to the speed")
    heading = float64("rad", "last heading while moving")
