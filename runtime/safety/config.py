# SPDX-License-Identifier: Apache-2.0
"""The bounds of the safety filter, and how it answers where there is a choice."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from runtime.errors import ConfigError

Age = Annotated[int, Meta(gt=0, le=5_000_000_000)]
Triple = tuple[float, float, float]
Answer = Literal["damp", "derate"]


class CommonSafetyConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits that every robot has.

    Attributes:
        tilt_max_rad: angle between the base's z axis and the vertical.
        temperature_max_degc: of a drive.
        voltage_min_v, voltage_max_v: of the battery.
        imu_age_max_ns: the robot is blind without a good inertial sample for longer.
        imu_frozen_samples: as it is after so many samples that are all alike.
        command_age_max_ns: it slows to a stand when the tracker's command is older.
        operator_age_max_ns: as it does without a sign of life of the operator for longer.
        localization_age_max_ns: as it does without a pose of the localisation for longer.
        disputed_poses_max: as it does when more poses in a row agree with each other but not with the estimate.
        overruns_stand: as it does at so many overruns of the loop in a row, and
        overruns_stand_ns: for at least so long.
        overruns_damp: at so many overruns in a row it is damped,
        gap_max_ns: and at once when the loop stood still for longer: its actuators have let go by themselves, and the
            robot is no longer as it was.
    """

    tilt_max_rad: Annotated[float, Meta(gt=0.1, le=1.5)] = 1.0
    temperature_max_degc: Annotated[float, Meta(gt=20.0, le=150.0)] = 85.0
    voltage_min_v: Annotated[float, Meta(gt=0.0, le=100.0)] = 20.0
    voltage_max_v: Annotated[float, Meta(gt=0.0, le=100.0)] = 34.0
    imu_age_max_ns: Age = 20_000_000
    imu_frozen_samples: Annotated[int, Meta(ge=2, le=1000)] = 10
    command_age_max_ns: Age = 200_000_000
    operator_age_max_ns: Age = 500_000_000
    localization_age_max_ns: Age = 1_000_000_000
    disputed_poses_max: Annotated[int, Meta(ge=1, le=1000)] = 10
    overruns_stand: Annotated[int, Meta(ge=1, le=100)] = 3
    overruns_stand_ns: Age = 2_000_000_000
    overruns_damp: Annotated[int, Meta(ge=1, le=100)] = 5
    gap_max_ns: Age = 20_000_000

    def check(self) -> None:
        """Cross-checks.

        Raises:
            ConfigError: naming the key and the bound.
        """
        if not self.voltage_min_v < self.voltage_max_v:
            raise ConfigError(f"voltage_min_v = {self.voltage_min_v} is not below voltage_max_v = {self.voltage_max_v}")
        self.check_order(("overruns_stand", "overruns_damp"))

    def check_order(self, *pairs: tuple[str, str]) -> None:
        """Compare pairs of keys.

        Raises:
            ConfigError: naming the first of a pair if it is above the second.
        """
        for lower, upper in pairs:
            low, high = getattr(self, lower), getattr(self, upper)
            if low > high:
                raise ConfigError(f"{lower} = {low} is above {upper} = {high}")


class SafetyConfig(CommonSafetyConfig, frozen=True, forbid_unknown_fields=True):
    """Limits of a robot on legs; those of joints for ab/ad, hip and knee of a left leg, ab/ad mirrored on the right.

    Attributes:
        position_min_rad, position_max_rad: commands beyond are clipped; a measured position more than
            `position_margin_rad` beyond damps the robot.
        position_margin_rad: as said.
        velocity_max_radps: commanded joint velocities above are clipped; measured ones damp the robot.
        stiffness_max_nm_prad, damping_max_nms_prad: commanded gains are clipped to between zero and these.
        effort_max_nm: feed-forward torques are clipped to this; and further, so that with what stiffness and damping
            add to them, as the joint was last measured, its drive is asked for no more.
        effort_rate_max_nmps: feed-forward torques that change faster are limited.
        saturation_nm, saturation_ns: a joint that gives more torque than that for so long is saturated.
        missing_replies_max: ticks in a row that a joint may go on with its last reply.
        forces_late_ns: a plan of forces this old is held, with a warning.
        forces_age_max_ns: with one this old the robot stands.
        forces_stand_max_ns: for at most so long.
        motor_fault, temperature, voltage, saturation: "damp", or "derate": first slow to a stand with
            `derated_effort_nm` as the bound of torques.
        derated_effort_nm: as said.
        derate_ns: damped after so long.
        derate_clear_ns: the full torque returns when the cause has been gone for so long.
        crouch_max_ns: a crouching robot is damped after so long.
        damping_nms_prad: of a damped joint.
    """

    position_min_rad: Triple = (-1.0, -2.2, 0.05)
    position_max_rad: Triple = (1.0, 1.5, 2.75)
    position_margin_rad: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.15
    velocity_max_radps: Annotated[float, Meta(gt=0.0, le=100.0)] = 30.0
    stiffness_max_nm_prad: Annotated[float, Meta(gt=0.0, le=500.0)] = 200.0
    damping_max_nms_prad: Annotated[float, Meta(gt=0.0, le=5.0)] = 5.0
    effort_max_nm: Annotated[float, Meta(gt=0.0, le=500.0)] = 33.0
    effort_rate_max_nmps: Annotated[float, Meta(gt=0.0, le=1e6)] = 20000.0
    saturation_nm: Annotated[float, Meta(gt=0.0, le=500.0)] = 32.0
    saturation_ns: Age = 100_000_000
    missing_replies_max: Annotated[int, Meta(ge=0, le=20)] = 3
    forces_late_ns: Age = 40_000_000
    forces_age_max_ns: Age = 200_000_000
    forces_stand_max_ns: Age = 500_000_000
    motor_fault: Answer = "damp"
    temperature: Answer = "derate"
    voltage: Answer = "damp"
    saturation: Answer = "derate"
    derated_effort_nm: Annotated[float, Meta(gt=0.0, le=500.0)] = 20.0
    derate_ns: Age = 3_000_000_000
    derate_clear_ns: Age = 500_000_000
    crouch_max_ns: Age = 1_000_000_000
    damping_nms_prad: Annotated[float, Meta(gt=0.0, le=5.0)] = 3.0

    def check(self) -> None:
        """Cross-checks.

        Raises:
            ConfigError: naming the key and the bound.
        """
        for low, high in zip(self.position_min_rad, self.position_max_rad, strict=True):
            if not low < high:
                raise ConfigError(f"position_min_rad = {low} is not below position_max_rad = {high}")
        super().check()
        self.check_order(("forces_late_ns", "forces_age_max_ns"), ("derated_effort_nm", "effort_max_nm"))
