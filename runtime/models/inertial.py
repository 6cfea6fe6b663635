# SPDX-License-Identifier: Apache-2.0
"""Whether an inertial sample can be what an IMU on this robot felt. Pure functions."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.signals import Imu

Array = npt.NDArray[np.float64]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]


class InertialConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a sample may be. An impact of a foot is felt; a spike of the sensor or of its wires is more than that.

    Attributes:
        acceleration_max_mps2, rate_max_radps: largest magnitudes.
        acceleration_jump_mps2, rate_jump_radps: largest magnitudes of the difference from one sample to the next.
    """

    acceleration_max_mps2: Positive = 160.0
    rate_max_radps: Positive = 35.0
    acceleration_jump_mps2: Positive = 100.0
    rate_jump_radps: Positive = 8.0


@compiled
def is_finite_sample(imu: Imu) -> bool:
    """Whether every number of an inertial sample is finite."""
    return bool(np.isfinite(imu.angular_velocity).all() and np.isfinite(imu.linear_acceleration).all())


@compiled
def is_plausible(config: InertialConfig, imu: Imu, good: Array, last: Array) -> bool:
    """Whether a finite sample is within its bounds, and follows from another.

    Args:
        config: bounds.
        imu: the sample.
        good: last good sample, specific force and angular velocity, (6,).
        last: last sample, good or not: of two in a row that agree, the second is believed.
    """
    bounded = (
        _size(imu.linear_acceleration) <= config.acceleration_max_mps2
        and _size(imu.angular_velocity) <= config.rate_max_radps
    )
    return bounded and (_follows(config, imu, good) or _follows(config, imu, last))


@compiled
def _follows(config: InertialConfig, imu: Imu, before: Array) -> bool:
    return bool(
        _size(imu.linear_acceleration - before[:3]) <= config.acceleration_jump_mps2
        and _size(imu.angular_velocity - before[3:]) <= config.rate_jump_radps
    )


@compiled
def _size(vector: Array) -> float:
    return math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
