# SPDX-License-Identifier: Apache-2.0
"""Parameters of a vehicle's tracker, and what it remembers."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.errors import ConfigError
from runtime.records import boolean, float64, int64, uint8
from runtime.tracking.delay import CAPACITY, CommandMemory
from runtime.tracking.followed_path import FollowedPathMemory
from runtime.tracking.speed import SpeedLimits
from runtime.tracking.turn import TurnLimits
from runtime.tracking.velocity import VelocityLimits

Seconds = Annotated[float, Meta(ge=0.0, le=2.0)]


class DriveTrackerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the tracker, whichever controller it has.

    Attributes:
        speed: limits of speed and yaw rate.
        turn: when and how to turn in place.
        velocity: limits of a velocity that the operator asks for instead.
        delay_s: from a command to its effect, which the pose is predicted over; 0 for no prediction.
        curvature_max_pm: of the arc that is driven, 1/m.
        search_window_m: how far ahead of the last progress the closest point is searched.
        start_window_m: the same when a path is new; a path is run from its start.
        longest_step_s: a longer gap between steps counts as this.
    """

    speed: SpeedLimits = msgspec.field(default_factory=SpeedLimits)
    turn: TurnLimits = msgspec.field(default_factory=TurnLimits)
    velocity: VelocityLimits = msgspec.field(default_factory=VelocityLimits)
    delay_s: Seconds = 0.1
    curvature_max_pm: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.3
    search_window_m: Annotated[float, Meta(ge=0.1, le=5.0)] = 1.0
    start_window_m: Annotated[float, Meta(ge=0.1, le=10.0)] = 3.0
    longest_step_s: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.1

    def check_delay(self, period_s: float) -> None:
        """Whether all commands within the delay can be remembered.

        Raises:
            ConfigError: if not.
        """
        if self.delay_s > CAPACITY * period_s:
            raise ConfigError(f"tracker.delay_s = {self.delay_s:g} is above {CAPACITY} periods of the tracker")


class DriveTrackerMemory(FollowedPathMemory, CommandMemory):
    """All that a vehicle's tracker remembers, the path it follows included."""

    stamp_ns = int64("ns", "of the last step, 0 before the first")
    arrived = boolean()
    turning = boolean("in place")
    progress = float64("m")
    speed = float64("m/s", "ramped")
    lateral = float64("m/s", "ramped")
    yaw_rate = float64("rad/s", "ramped")
    manner = uint8()
