# SPDX-License-Identifier: Apache-2.0
"""What the simulator is told of a vehicle's suspension, motors and control unit; the runtime never reads these."""

from __future__ import annotations

from typing import Annotated

import msgspec

from runtime.robots.simulation import NonNegative, Positive, PositiveInt, WorldConfig

Delay = Annotated[int, msgspec.Meta(ge=0, le=10_000_000_000)]


class VehicleSimulationConfig(WorldConfig, frozen=True, forbid_unknown_fields=True):
    """Physics, motors, control unit and sensors of a simulated vehicle.

    Attributes:
        terrain_friction: of the tyres on the ground, where no patch has another.
        suspension_stiffness_npm, suspension_damping_nspm, suspension_travel_m: of each wheel; travel to either side.
        rolling_resistance_nm: of each wheel, with its gear.
        steering_rate_radps: speed limit of each steering motor.
        center_rate_radps: limit of the steering angle of a bicycle whose front wheel is in the vehicle's middle (the
            "centre angle"): each motor turns no faster than dual Ackermann steering needs for it.
        steering_lag_s: first-order lag of each steering motor behind its profile.
        steering_torque_nm, steering_stiffness_nm_prad, steering_damping_nms_prad, steering_armature_kg_m2: of each
            steering motor and its position controller, at the steering axis.
        stuck_error_rad, stuck_speed_radps, stuck_ns: a steering motor that is so far from its profile and so slow for
            so long is reported as stuck.
        peak_torque_nm, no_load_speed_radps: torque-speed curve of a driving motor at the wheel.
        speed_gain_nms_prad, speed_reset_s: of each wheel's speed controller, proportional and integral.
        acceleration_radps2, deceleration_radps2: limits of the wheels' speed profiles, away from rest and towards it.
        brake_torque_nm: of each wheel's brake, which closes without power.
        torque_constant_nm_pa: of a driving motor, at the wheel.
        angle_noise_rad, speed_noise_radps: standard deviations of what the encoders say.
        command_delay_ns: from a command's arrival to its effect.
        command_timeout_ns: without a good set of commands for that long the unit brakes.
        state_period_ns, temperature_period_ns: of the state frames.
        state_phase_ns: when in its period a state frame is sent.
        ambient_degc, heating_k_ps_pnm2, cooling_s, motor_limit_degc: thermal model of a driving motor.
    """

    terrain_friction: Positive = 0.9
    battery_v: Positive = 51.0
    battery_resistance_ohm: NonNegative = 0.03
    battery_capacity_ah: Positive = 40.0
    suspension_stiffness_npm: Positive = 15_000.0
    suspension_damping_nspm: NonNegative = 600.0
    suspension_travel_m: Positive = 0.06
    rolling_resistance_nm: NonNegative = 0.5
    steering_rate_radps: Positive = 1.5
    center_rate_radps: Positive = 1_000.0
    steering_lag_s: NonNegative = 0.05
    steering_torque_nm: Positive = 80.0
    steering_stiffness_nm_prad: Positive = 2_000.0
    steering_damping_nms_prad: NonNegative = 60.0
    steering_armature_kg_m2: NonNegative = 0.3
    stuck_error_rad: Positive = 0.1
    stuck_speed_radps: Positive = 0.02
    stuck_ns: PositiveInt = 300_000_000
    peak_torque_nm: Positive = 40.0
    no_load_speed_radps: Positive = 20.0
    speed_gain_nms_prad: Positive = 25.0
    speed_reset_s: Positive = 0.2
    acceleration_radps2: Positive = 10.0
    deceleration_radps2: Positive = 20.0
    brake_torque_nm: Positive = 35.0
    torque_constant_nm_pa: Positive = 1.2
    angle_noise_rad: NonNegative = 0.0002
    speed_noise_radps: NonNegative = 0.01
    command_delay_ns: Delay = 0
    command_timeout_ns: PositiveInt = 100_000_000
    state_period_ns: PositiveInt = 10_000_000
    temperature_period_ns: PositiveInt = 100_000_000
    state_phase_ns: Delay = 5_000_000
    ambient_degc: float = 25.0
    heating_k_ps_pnm2: NonNegative = 0.001
    cooling_s: Positive = 600.0
    motor_limit_degc: float = 110.0
