# SPDX-License-Identifier: Apache-2.0
"""The steering and driving motors of a vehicle, with the controllers that its control unit runs for them.

A steering motor follows a profile of limited speed with a first-order lag; a driving motor follows a speed profile of
limited acceleration and deceleration within its torque-speed curve. Both act on the true motion; what is reported of it
is noisy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.models.vehicle import WHEELS, Vehicle
from runtime.robots.vehicle_simulation import VehicleSimulationConfig
from sim_bridge.drive_model import DriveModel, Windings, available_torque

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
STEERING, DRIVING = 1, 2
"""Columns of the joints of each wheel; the suspension's is before them."""
COUNT = len(WHEELS)


class VehicleMotors:
    """Eight motors.

    Args:
        vehicle: geometry.
        config: of motors and controllers.

    Attributes:
        torque: (4, 2) N.m at each steering axis and each wheel, to hold until the next `update`.
        target: (2, 4) commanded angles (rad) and speeds (rad/s).
        idle: (8,) whether each motor is without power, the steering motors first; a steering axis then stays.
        braked: the driving motors are without power and the steering motors hold their angles.
    """

    def __init__(self, vehicle: Vehicle, config: VehicleSimulationConfig) -> None:
        self._config = table_of(config)
        self._steps = np.array([config.time_step_ns * 1e-9, _share(config)])
        places = vehicle.wheel_positions()
        self._aspect = places[:, 1] / places[:, 0]
        self.torque, self.target = np.zeros((COUNT, 2)), np.zeros((2, COUNT))
        self.idle, self.braked = np.zeros(2 * COUNT, np.bool_), True
        self._profile = np.zeros((4, COUNT))
        self._windings = Windings([_heat_model(config)] * COUNT)

    @property
    def temperature(self) -> Array:
        """Of the windings of each driving motor, degC."""
        return self._windings.excess + self._windings.ambient

    @property
    def hot(self) -> Flags:
        """Whether each driving motor is above its limit."""
        return self._windings.hot

    def heat(self, wheel: int, kelvin: float) -> None:
        """Make a driving motor warmer."""
        self._windings.excess[wheel] += kelvin

    def lag(self, position: Array) -> Array:
        """How far each steering axis is from its profile, rad, given the joints (4, 3)."""
        return np.abs(self._profile[_LAGGED] - position[:, STEERING])

    def warm(self, now_ns: int) -> bool:
        """Let the torque heat the windings; whether they changed."""
        due = self._windings.due(now_ns)
        if due:
            self._windings.update(self.torque[:, 1], now_ns)
        return due

    def update(self, position: Array, velocity: Array) -> None:
        """One step of all controllers, given the wheels' joints (4, 3)."""
        _update(
            self._config,
            self._steps,
            self._aspect,
            position,
            velocity,
            self.target,
            self.idle,
            self.braked,
            self._profile,
            self.torque,
        )


_ANGLE, _LAGGED, _SPEED, _INTEGRAL = range(4)
"""Rows of the controllers' memory: profile of the angle, the same with its lag, profile of the speed, integral part."""


def _share(config: VehicleSimulationConfig) -> float:
    """Of the way to its profile, what a steering motor goes in a step."""
    step_s = config.time_step_ns * 1e-9
    return -math.expm1(-step_s / config.steering_lag_s) if config.steering_lag_s else 1.0


def _heat_model(config: VehicleSimulationConfig) -> DriveModel:
    return DriveModel(
        peak_torque=config.peak_torque_nm,
        no_load_speed=config.no_load_speed_radps,
        encoder_counts=1,
        velocity_noise=config.speed_noise_radps,
        command_timeout_ns=config.command_timeout_ns,
        timeout_damping=0.0,
        ambient_temperature=config.ambient_degc,
        heating=config.heating_k_ps_pnm2,
        cooling_time=config.cooling_s,
        temperature_limit=config.motor_limit_degc,
        bus_voltage=config.battery_v,
    )


@compiled
def _toward(value: float, target: float, most: float) -> float:
    return value + min(max(target - value, -most), most)


@compiled
def _turning_speed(angle: float, aspect: float, motor: float, center: float) -> float:
    """The speed limit of a steering motor.

    With dual Ackermann steering a wheel at (x, y) turns at ((cos a + y/x sin a)^2 + sin^2 a) times the rate of the
    centre angle.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    return min(motor, center * ((cosine + aspect * sine) ** 2 + sine**2))


@compiled
def _update(
    table: Sequence[VehicleSimulationConfig],
    steps: Array,
    aspect: Array,
    position: Array,
    velocity: Array,
    target: Array,
    idle: Flags,
    braked: bool,
    profile: Array,
    torque: Array,
) -> None:
    config = table[0]
    step_s, share = steps
    slope = config.peak_torque_nm / config.no_load_speed_radps
    for wheel in range(torque.shape[0]):
        angle, rate, speed = position[wheel, STEERING], velocity[wheel, STEERING], velocity[wheel, DRIVING]
        if braked or idle[wheel]:
            profile[_ANGLE, wheel] = profile[_LAGGED, wheel]
        else:
            most = step_s * _turning_speed(
                profile[_ANGLE, wheel], aspect[wheel], config.steering_rate_radps, config.center_rate_radps
            )
            profile[_ANGLE, wheel] = _toward(profile[_ANGLE, wheel], target[0, wheel], most)
        before = profile[_LAGGED, wheel]
        profile[_LAGGED, wheel] += share * (profile[_ANGLE, wheel] - before)
        wanted = config.steering_stiffness_nm_prad * (profile[_LAGGED, wheel] - angle)
        wanted += config.steering_damping_nms_prad * ((profile[_LAGGED, wheel] - before) / step_s - rate)
        torque[wheel, 0] = min(max(wanted, -config.steering_torque_nm), config.steering_torque_nm)
        if braked or idle[torque.shape[0] + wheel]:
            profile[_SPEED, wheel], profile[_INTEGRAL, wheel], torque[wheel, 1] = speed, 0.0, 0.0
            continue
        slows = profile[_SPEED, wheel] * (target[1, wheel] - profile[_SPEED, wheel]) < 0.0
        limit = config.deceleration_radps2 if slows else config.acceleration_radps2
        profile[_SPEED, wheel] = _toward(profile[_SPEED, wheel], target[1, wheel], step_s * limit)
        error = profile[_SPEED, wheel] - speed
        integral = profile[_INTEGRAL, wheel] + error * step_s * config.speed_gain_nms_prad / config.speed_reset_s
        wanted = config.speed_gain_nms_prad * error + integral
        given = available_torque(wanted, speed, config.peak_torque_nm, slope)
        if given == wanted:
            profile[_INTEGRAL, wheel] = integral
        torque[wheel, 1] = given
