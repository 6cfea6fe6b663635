# SPDX-License-Identifier: Apache-2.0
"""Parameters of the state estimation of a vehicle on steered wheels."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from runtime.estimation.kalman_config import InertialFilterConfig, Positive

Share = Annotated[float, Meta(gt=0.0, le=1.0)]
Seconds = Annotated[float, Meta(ge=0.001, le=10.0)]


class VehicleFilterConfig(InertialFilterConfig, frozen=True, forbid_unknown_fields=True):
    """Noise and thresholds.

    Attributes:
        rolling_mps: standard deviation of a wheel's rolling speed, at any speed, and
        rolling_share: as a share of that speed; both added as variances.
        lateral_mps: standard deviation of a wheel's speed across its direction, at any speed.
        steering_rad: of a steering angle.
        slip_gate: a wheel whose residual is this many standard deviations slips, and counts a quarter; see
            `wheel_odometry`.
        twist_mps, twist_radps: standard deviations of what all wheels have wrong together, at any speed, and
        twist_share: as a share of the speed.
        twist_gate: the twist counts a quarter where it contradicts the filter by so many standard deviations.
        vertical_mps: standard deviation of the velocity along z of base.
        wheels_age_max_s: older readings of the wheels are not used.
        rest_speed_mps: the vehicle may be at rest while no wheel rolls faster, on average over
        rest_filter_s: this time,
        rest_rate_radps: and while it turns no faster than this, bias removed.
        rest_s: it is, when that has been so for so long.
        rest_velocity_mps: standard deviation of its velocity then.
    """

    acceleration_noise: Positive = 0.02
    localization_gate: Positive = 10.0
    longest_step_s: Annotated[float, Meta(ge=0.001, le=1.0)] = 0.2
    rolling_mps: Positive = 0.01
    rolling_share: Share = 0.02
    lateral_mps: Positive = 0.02
    steering_rad: Positive = 0.01
    slip_gate: Positive = 3.0
    twist_mps: Positive = 0.02
    twist_share: Share = 0.04
    twist_radps: Positive = 0.05
    twist_gate: Positive = 3.0
    vertical_mps: Positive = 0.05
    wheels_age_max_s: Seconds = 0.05
    rest_speed_mps: Positive = 0.005
    rest_filter_s: Seconds = 0.1
    rest_rate_radps: Positive = 0.05
    rest_s: Seconds = 0.3
    rest_velocity_mps: Positive = 0.002
