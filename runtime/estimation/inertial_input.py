# SPDX-License-Identifier: Apache-2.0
"""What an estimator takes up at each step: the time since the last, and the newest inertial sample if it is good."""

from __future__ import annotations

import numpy as np

from runtime.compiled import compiled
from runtime.estimation.kalman_config import InertialFilterConfig
from runtime.models.inertial import InertialConfig, is_finite_sample, is_plausible
from runtime.records import Record, float64_array, int64, uint32
from runtime.signals import Imu


class StepMemory(Record):
    """When the last step was."""

    step_ns = int64("ns", "time of the last step, 0 before the first")


class InertialMemory(Record):
    """The last good inertial sample."""

    rate = float64_array(3, "rad/s", "last good sample")
    acceleration = float64_array(3, "m/s^2", "last good sample")
    last_sample = float64_array(6, "m/s^2, rad/s", "good or not")
    imu_sequence = int64()
    imu_stamp_ns = int64("ns", "of the last good sample")
    imu_taken_ns = int64("ns", "when that was taken up")
    samples_rejected = uint32()


@compiled
def seconds_since_last(memory: StepMemory, now_ns: int, period_s: float, longest_s: float) -> float:
    """Time since the last step, of which this becomes one, s; the loop's period at the first."""
    before_ns, memory.step_ns = memory.step_ns, now_ns
    return min((now_ns - before_ns) * 1e-9, longest_s) if before_ns > 0 else period_s


@compiled
def take_up(
    config: InertialFilterConfig, inertial: InertialConfig, memory: InertialMemory, imu: Imu, now_ns: int
) -> bool:
    """Take up the newest sample if it is good, keeping the last good one otherwise.

    Returns:
        Whether the last good sample is recent enough to go by.
    """
    if imu.sequence != memory.imu_sequence:
        memory.imu_sequence = imu.sequence
        in_order = memory.imu_stamp_ns <= imu.stamp_ns <= now_ns + int(config.longest_step_s * 1e9)
        good, last = np.concatenate((memory.acceleration, memory.rate)), memory.last_sample.copy()
        memory.last_sample[:3], memory.last_sample[3:] = imu.linear_acceleration, imu.angular_velocity
        if in_order and is_finite_sample(imu) and is_plausible(inertial, imu, good, last):
            memory.rate[:] = imu.angular_velocity
            memory.acceleration[:] = imu.linear_acceleration
            memory.imu_stamp_ns, memory.imu_taken_ns = imu.stamp_ns, now_ns
        else:
            memory.samples_rejected += 1
    return (now_ns - memory.imu_taken_ns) * 1e-9 <= config.longest_step_s
