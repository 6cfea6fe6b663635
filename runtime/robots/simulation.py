# SPDX-License-Identifier: Apache-2.0
"""What the simulator is told of a robot's sensors, actuators and ground; the runtime itself never reads these."""

from __future__ import annotations

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
PositiveInt = Annotated[int, msgspec.Meta(gt=0, le=10_000_000_000)]


class WorldConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Physics and sensors of any simulated robot.

    Attributes:
        time_step_ns: of the physics.
        terrain_friction, impedance_ratio, contact_time_s, contact_damping_ratio: MuJoCo's contact parameters.
        imu_rate_hz, imu_acceleration_noise, imu_rate_noise: sampling and noise density, m/s^2 and rad/s per root hertz.
        imu_acceleration_bias_mps2, imu_rate_bias_radps: standard deviations of the initial biases.
        imu_acceleration_walk, imu_rate_walk: random walks of the biases.
        localization_rate_hz, localization_position_m, localization_angle_rad, localization_latency_ns: of the stand-in
            for SLAM.
        battery_v, battery_resistance_ohm, battery_capacity_ah: of the battery.
    """

    time_step_ns: PositiveInt = 1_000_000
    terrain_friction: Positive = 0.8
    impedance_ratio: Positive = 100.0
    contact_time_s: Positive = 0.005
    contact_damping_ratio: Positive = 1.0
    imu_rate_hz: Annotated[int, msgspec.Meta(ge=100, le=1000)] = 500
    imu_acceleration_noise: NonNegative = 0.003
    imu_rate_noise: NonNegative = 0.0003
    imu_acceleration_bias_mps2: NonNegative = 0.05
    imu_rate_bias_radps: NonNegative = 0.003
    imu_acceleration_walk: NonNegative = 0.0005
    imu_rate_walk: NonNegative = 0.00003
    localization_rate_hz: Annotated[int, msgspec.Meta(ge=1, le=100)] = 10
    localization_position_m: NonNegative = 0.02
    localization_angle_rad: NonNegative = 0.008726646259971648
    localization_latency_ns: PositiveInt = 80_000_000
    battery_v: Positive = 29.4
    battery_resistance_ohm: NonNegative = 0.05
    battery_capacity_ah: Positive = 8.0


class SimulationConfig(WorldConfig, frozen=True, forbid_unknown_fields=True):
    """Physics, drives and sensors of a simulated robot with legs.

    Attributes:
        joint_viscous_nms_prad, joint_coulomb_nm: friction of every joint.
        peak_torque_nm, no_load_speed_radps: torque-speed curve of an actuator at the joint.
        encoder_counts: per turn of a drive.
        velocity_noise_radps: standard deviation of a drive's measured speed.
        command_timeout_ns, timeout_damping_nms_prad: a drive without commands for that long damps.
        ambient_degc, heating_k_ps_pnm2, cooling_s, drive_limit_degc: thermal model of a drive.
    """

    joint_viscous_nms_prad: NonNegative = 0.02
    joint_coulomb_nm: NonNegative = 0.1
    peak_torque_nm: Positive = 33.0
    no_load_speed_radps: Positive = 25.0
    encoder_counts: PositiveInt = 16384
    velocity_noise_radps: NonNegative = 0.02
    command_timeout_ns: PositiveInt = 20_000_000
    timeout_damping_nms_prad: NonNegative = 3.0
    ambient_degc: float = 25.0
    heating_k_ps_pnm2: NonNegative = 0.002
    cooling_s: Positive = 300.0
    drive_limit_degc: float = 100.0


class ScenarioConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Changes to a scenario; without them it is as its definition says.

    Attributes:
        speed_mps: commanded speed; 0 keeps the scenario's own.
        push_impulse_n_s: impulse of the scenario `push`.
    """

    speed_mps: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.0
    push_impulse_n_s: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 10.0
