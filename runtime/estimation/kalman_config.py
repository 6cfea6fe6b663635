# SPDX-License-Identifier: Apache-2.0
"""Parameters of the state estimation."""

from __future__ import annotations

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]


class InertialFilterConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Noise and thresholds of the IMU and of the localisation, whatever the robot moves on.

    Attributes:
        acceleration_noise, rate_noise: of the IMU's samples, per root hertz.
        acceleration_walk, rate_walk: drift of its biases.
        localization_position_m, localization_yaw_rad: standard deviations of the localisation sensor.
        localization_gate: innovations beyond this many standard deviations are rejected and counted.
        localization_jump_m, localization_jump_rad: and so are those beyond these, however uncertain the estimate is.
        longest_step_s: a longer gap between steps counts as this.
    """

    acceleration_noise: Positive = 0.05
    rate_noise: Positive = 0.002
    acceleration_walk: Positive = 0.005
    rate_walk: Positive = 2e-4
    localization_position_m: Positive = 0.02
    localization_yaw_rad: Positive = 0.0087
    localization_gate: Positive = 6.0
    localization_jump_m: Positive = 0.5
    localization_jump_rad: Positive = 0.35
    longest_step_s: Annotated[float, msgspec.Meta(ge=0.001, le=1.0)] = 0.05


class KalmanConfig(InertialFilterConfig, frozen=True, forbid_unknown_fields=True):
    """The same of a robot on legs.

    Attributes:
        contact_velocity_mps: standard deviation of a standing foot's contact point from rest.
        landing_velocity_mps: the same right after touchdown and right before lift-off.
        contact_force_n: normal force from which a foot carries load.
        early_contact_force_n: the same for a foot that is scheduled to be in the air.
        contact_filter_s: low-pass on the estimated force.
        plane_time_s: low-pass on the stance plane's normal.
        course_time_s: averaging of the course velocity, about one gait cycle.
    """

    contact_velocity_mps: Positive = 0.03
    landing_velocity_mps: Positive = 0.3
    contact_force_n: Positive = 12.0
    early_contact_force_n: Positive = 20.0
    contact_filter_s: Positive = 0.006
    plane_time_s: Positive = 0.1
    course_time_s: Positive = 0.3
