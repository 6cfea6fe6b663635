# SPDX-License-Identifier: Apache-2.0
"""The limits of a legged robot, and what breaks them. Pure functions."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.errors import ConfigError
from runtime.signals import BodyState, Fault, Imu, JointCommand, JointState

Array = npt.NDArray[np.float64]
Age = Annotated[int, msgspec.Meta(gt=0, le=5_000_000_000)]
Triple = tuple[float, float, float]


class SafetyConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits. Joint limits are for ab/ad, hip and knee of a left leg; ab/ad is mirrored on the right.

    Attributes:
        position_min_rad, position_max_rad: commands beyond are clipped; a measured position more than
            `position_margin_rad` beyond damps the robot.
        position_margin_rad: as said.
        velocity_max_radps: commanded joint velocities above are clipped; measured ones damp the robot.
        stiffness_max_nm_prad, damping_max_nms_prad: commanded gains are clipped to between zero and these.
        effort_max_nm: feed-forward torques above are clipped.
        effort_rate_max_nmps: feed-forward torques that change faster are limited.
        tilt_max_rad: angle between the trunk's z axis and the vertical.
        temperature_max_degc: of a drive.
        voltage_min_v, voltage_max_v: of the battery.
        imu_age_max_ns, motor_age_max_ns, forces_age_max_ns, command_age_max_ns, localization_age_max_ns: staleness
            bounds.
        damping_nms_prad: of a damped joint.
    """

    position_min_rad: Triple = (-1.0, -2.2, 0.05)
    position_max_rad: Triple = (1.0, 1.5, 2.75)
    position_margin_rad: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.15
    velocity_max_radps: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 30.0
    stiffness_max_nm_prad: Annotated[float, msgspec.Meta(gt=0.0, le=500.0)] = 200.0
    damping_max_nms_prad: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)] = 5.0
    effort_max_nm: Annotated[float, msgspec.Meta(gt=0.0, le=500.0)] = 33.0
    effort_rate_max_nmps: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] = 20000.0
    tilt_max_rad: Annotated[float, msgspec.Meta(gt=0.1, le=1.5)] = 1.0
    temperature_max_degc: Annotated[float, msgspec.Meta(gt=20.0, le=150.0)] = 85.0
    voltage_min_v: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 20.0
    voltage_max_v: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 34.0
    imu_age_max_ns: Age = 20_000_000
    motor_age_max_ns: Age = 20_000_000
    forces_age_max_ns: Age = 100_000_000
    command_age_max_ns: Age = 500_000_000
    localization_age_max_ns: Age = 1_000_000_000
    damping_nms_prad: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)] = 3.0

    def check(self) -> None:
        """Cross-checks.

        Raises:
            ConfigError: naming the key and the bound.
        """
        for low, high in zip(self.position_min_rad, self.position_max_rad, strict=True):
            if not low < high:
                raise ConfigError(f"position_min_rad = {low} is not below position_max_rad = {high}")
        if not self.voltage_min_v < self.voltage_max_v:
            raise ConfigError(f"voltage_min_v = {self.voltage_min_v} is not below voltage_max_v = {self.voltage_max_v}")


def joint_bounds(config: SafetyConfig) -> tuple[Array, Array]:
    """Lowest and highest positions of the twelve joints, ab/ad mirrored on the right legs."""
    low, high = np.array(config.position_min_rad), np.array(config.position_max_rad)
    right_low, right_high = low.copy(), high.copy()
    right_low[0], right_high[0] = -high[0], -low[0]
    return np.concatenate((low, right_low) * 2), np.concatenate((high, right_high) * 2)


@compiled
def tilt(orientation: Array) -> float:
    """Angle between the trunk's z axis and the vertical, rad; NaN if the orientation is not finite."""
    if not np.isfinite(orientation).all():
        return math.nan
    x, y = orientation[0], orientation[1]
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))


@compiled
def is_finite_sample(imu: Imu) -> bool:
    """Whether every number of an inertial sample is finite."""
    return bool(np.isfinite(imu.angular_velocity).all() and np.isfinite(imu.linear_acceleration).all())


@compiled
def sensor_faults(
    config: SafetyConfig, now_ns: int, imu_ns: int, joints: JointState, body: BodyState, voltage: float
) -> int:
    """What is wrong with the inputs, as bits of `Fault`.

    Args:
        config: limits.
        now_ns: the present.
        imu_ns: stamp of the last inertial sample that was finite.
        joints: measured.
        body: estimated.
        voltage: of the battery, V; 0 if it is not known.
    """
    found = 0
    if now_ns - imu_ns > config.imu_age_max_ns:
        found |= Fault.STALE_IMU.value
    oldest_ns = joints.reply_ns.min()
    if oldest_ns == 0 or now_ns - oldest_ns > config.motor_age_max_ns:
        found |= Fault.STALE_MOTOR.value
    if joints.error.any():
        found |= Fault.MOTOR_FAULT.value
    if (joints.temperature > config.temperature_max_degc).any():
        found |= Fault.TEMPERATURE.value
    if not (np.abs(joints.velocity) <= config.velocity_max_radps).all():
        found |= Fault.JOINT_VELOCITY.value
    if voltage > 0.0 and not config.voltage_min_v <= voltage <= config.voltage_max_v:
        found |= Fault.VOLTAGE.value
    if body.localization_age_ns > config.localization_age_max_ns:
        found |= Fault.STALE_LOCALIZATION.value
    if not tilt(body.orientation) <= config.tilt_max_rad:
        found |= Fault.TILT.value
    return found


@compiled
def is_finite(command: JointCommand) -> bool:
    """Whether every number of a command is finite."""
    return bool(
        np.isfinite(command.position).all()
        and np.isfinite(command.velocity).all()
        and np.isfinite(command.effort).all()
        and np.isfinite(command.stiffness).all()
        and np.isfinite(command.damping).all()
    )


@compiled
def within(wanted: Array, low: Array, high: Array, limited: Array) -> int:
    """Put the values within their bounds into `limited`; returns how many had to be altered."""
    altered = 0
    for row in range(wanted.shape[0]):
        limited[row] = min(max(wanted[row], low[row]), high[row])
        altered += limited[row] != wanted[row]
    return altered
