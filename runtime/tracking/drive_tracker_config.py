# SPDX-License-Identifier: Apache-2.0
"""Parameters of the task that steers a vehicle, and what it remembers."""

from __future__ import annotations

import msgspec

from runtime.records import Record, boolean, float64, float64_array, int64, uint8, uint32_array
from runtime.tracking.followed_path import FollowedPathMemory
from runtime.tracking.traction import TractionConfig
from runtime.tracking.vehicle_tracker import VehicleTracker, VehicleTrackerConfig
from runtime.tracking.velocity import VelocityLimits


class DriveTrackerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the tracker, whichever controller it has.

    Attributes:
        following: of a path.
        velocity: limits of a velocity that the operator asks for instead.
        traction: when the vehicle slides, and what it then counts on.
    """

    following: VehicleTrackerConfig = msgspec.field(default_factory=VehicleTrackerConfig)
    velocity: VelocityLimits = msgspec.field(default_factory=VelocityLimits)
    traction: TractionConfig = msgspec.field(default_factory=TractionConfig)


class SolveMemory(Record):
    """What a controller remembers that solves a problem at every step; arrays of one, so that they can be shared."""

    angle = float64_array(1, "rad", "centre angle that was commanded last")
    residual = float64_array(1, "", "of the last solve")
    failures = uint32_array(1, "", "solves that failed since start")


class DriveTrackerMemory(FollowedPathMemory, SolveMemory):
    """All that the task remembers, the path it follows included."""

    stamp_ns = int64("ns", "of the last step, 0 before the first")
    arrived = boolean()
    roaming = boolean("the last command was not for the path")
    forward = float64("m/s", "last command")
    lateral = float64("m/s", "last command")
    yaw_rate = float64("rad/s", "last command")
    progress = float64("m", "along the path")
    manner = uint8("", "SteeringMode of the last command")
    lost = float64("", "share of the accelerations that is not counted on, since the vehicle slides or has slid")
    tracked = float64_array(VehicleTracker.SIZE, "", "what the path's tracker remembers")
