# SPDX-License-Identifier: Apache-2.0
"""The values that cross a task boundary of a vehicle, beside those that every robot has (`runtime.signals`).

Conventions as there. `base` lies at the vehicle's centre, on the ground. Wheels in the order front left, front right,
rear left, rear right; a steering angle is positive to the left, a wheel's speed positive forward. Symbolic sizes:
`wheel`, `axle_drive` (a steering and a driving motor for each wheel, the steering ones first) and `unit_frame` (state
frames of the vehicle's control unit).
"""

from __future__ import annotations

from enum import IntEnum

from runtime.records import (
    Record,
    boolean,
    boolean_array,
    float64,
    float64_array,
    int64,
    int64_array,
    uint8,
    uint8_array,
    uint32,
)


class SteeringMode(IntEnum):
    """Ways of steering.

    In ACKERMANN front and rear wheels steer opposite, so that the centre of rotation lies on the lateral axis; in CRAB
    all wheels are parallel; in SPIN the vehicle turns about its centre; FREE is any motion.
    """

    ACKERMANN = 0
    CRAB = 1
    SPIN = 2
    FREE = 3


class WheelState(Record):
    """What the vehicle's control unit says of its wheels and of itself."""

    stamp_ns = int64("ns", "of the newest state frame")
    reply_ns = int64_array("unit_frame", "ns", "arrival of the last valid state frame of each kind")
    steering = float64_array("wheel", "rad")
    speed = float64_array("wheel", "rad/s")
    current = float64_array("wheel", "A", "of the driving motors")
    temperature = float64_array("wheel", "degC", "of the driving motors")
    fault = uint8_array("axle_drive", "", "the unit's own fault code, 0 none; steering motors, then driving motors")
    mode = uint8("", "of the unit, as it counts them")
    enabled = boolean("the unit drives its motors")
    corrupt = uint32("", "state frames since start whose checksum was wrong")
    stalled = uint32("", "state frames since start whose alive counter did not go on")
    rejected = uint32("", "frames rejected since start: wrong length, unknown id, error frame, out of range")


class WheelStatus(Record):
    """What is wrong with single wheels."""

    stamp_ns = int64("ns")
    stuck = boolean_array("wheel", "the steering did not follow while the unit last drove, or cannot by its own word")


class WheelCommand(Record):
    """One command for every wheel."""

    stamp_ns = int64("ns")
    mode = uint8("", "asked of the unit, as it counts them")
    enable = boolean("the motors are to be driven")
    steering = float64_array("wheel", "rad")
    speed = float64_array("wheel", "rad/s")
    manner = uint8("", "SteeringMode: 0 ackermann, 1 crab, 2 spin, 3 free")
    phase = uint8("", "what the vehicle is at: 0 rolling, 1 stopping to be steered anew, 2 steering")


class VehicleState(Record):
    """The estimate of the vehicle."""

    stamp_ns = int64("ns")
    position = float64_array(3, "m", "centre in odom")
    orientation = float64_array(4, "", "x y z w")
    linear_velocity = float64_array(3, "m/s", "of the centre, in odom")
    angular_velocity = float64_array(3, "rad/s", "in base, bias removed")
    velocity = float64_array(2, "m/s", "forward and lateral, in base")
    slip = float64_array("wheel", "", "slip ratio: (rolling speed - ground speed) / the larger of both")
    slipping = boolean_array("wheel", "the wheel's speed says nothing of the vehicle's")
    localization_age_ns = int64("ns", "age of the newest pose that was fused")
    localization_rejected = uint32("", "poses rejected since start")
    localization_disputed = uint32("", "poses in a row that agree with each other but not with the estimate")
    imu_age_ns = int64("ns", "age of the inertial sample that was used")
    imu_rejected = uint32("", "samples since start that were not finite, not plausible or not in order of time")
    covariance = float64_array(9, "m^2, m.rad, rad^2", "of x, y and yaw, row by row")
    wheels_age_ns = int64("ns", "age of the state frames that were used, the oldest wheel's")
    wheels_rejected = uint32("", "readings of the wheels since start that were not finite")
    yaw_rate_innovation = float64("rad/s", "yaw rate of the wheels less that of the gyroscope")
    resting = boolean("the vehicle is taken to stand still")


class VehicleTruth(Record):
    """The simulator's state of the vehicle, for `--estimator truth` and for the errors of a run."""

    stamp_ns = int64("ns")
    position = float64_array(3, "m", "centre in odom")
    orientation = float64_array(4, "", "x y z w")
    linear_velocity = float64_array(3, "m/s", "of the centre, in odom")
    angular_velocity = float64_array(3, "rad/s", "in base")
    steering = float64_array("wheel", "rad")
    speed = float64_array("wheel", "rad/s")
    slip = float64_array("wheel", "", "slip ratio: (rolling speed - ground speed) / the larger of both")
    normal_force = float64_array("wheel", "N", "of the ground on each wheel")


class CommandDelay(Record):
    """How late the vehicle answers."""

    stamp_ns = int64("ns")
    delay = float64("s", "from a command to what the wheels do, as learnt; 0 where none is reckoned with")


class TwistCommand(Record):
    """What the tracker asks of the vehicle's centre."""

    stamp_ns = int64("ns")
    velocity = float64_array(2, "m/s", "forward and lateral, in base")
    yaw_rate = float64("rad/s")
    manner = uint8("", "SteeringMode that is asked for: 0 ackermann, 1 crab, 2 spin, 3 free")
    predicted = float64_array(3, "m, m, rad", "pose that the command is made for: the estimate after the delay")
    look_ahead = float64("m")
    target = float64_array(2, "m", "look-ahead point in odom")
    lateral_error = float64("m", "signed, positive with the path to the right")
    heading_error = float64("rad")
    progress = float64("m", "arc length along the path")
    remaining = float64("m", "arc length to the goal")
    arrived = boolean("the goal has been reached")
    rejected_paths = uint32("", "paths rejected since start")
    foreign_paths = uint32("", "those of them that were not of the lease's holder")
    grip = float64("", "share of the accelerations that is counted on; below 1 the vehicle slides, or has slid")
    residual = float64("", "of the last solve, where the controller solves something")
    failures = uint32("", "solves that failed since start; the last good command was held")
