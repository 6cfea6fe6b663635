# SPDX-License-Identifier: Apache-2.0
"""How soon a vehicle's answers to faults are due, by its configuration."""

from __future__ import annotations

import math
from collections.abc import Callable

from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.tracking.bends import CURVE_RADIUS_M, arc
from sim_bridge.faults.table_parts import MS, imu_stale

ANSWER_NS = 100 * MS
"""From a command to what the wheels do: frames both ways, and the lag of the speed control."""
Bound = Callable[[Vehicle4ws4wdConfig], int]


def ticks(count: int) -> Bound:
    """So many ticks of the loop."""
    return lambda config: count * config.loops.drive_period_ns


def _slowed(config: Vehicle4ws4wdConfig, deceleration_mps2: float) -> int:
    """Until the fastest wheel, the outer front one in a bend of the course, has slowed from the speed of the drive."""
    vehicle, curvature = config.vehicle, 1.0 / CURVE_RADIUS_M
    ratio = math.hypot(1.0 + 0.5 * curvature * vehicle.track_m, 0.5 * curvature * vehicle.wheelbase_m)
    return round(ratio * config.scenario.speed_mps / deceleration_mps2 * 1e9) + ANSWER_NS


def rested(after: Bound) -> Bound:
    """Until a fault is known, and the vehicle has braked to a stand."""
    return lambda config: after(config) + _slowed(config, config.safety.brake_mps2)


def unheard(after: Bound) -> Bound:
    """The same where the unit hears nothing: it brakes by itself, and harder, once it has given up waiting."""
    return lambda config: rested(after)(config) + config.simulation.command_timeout_ns


def stood(after: Bound) -> Bound:
    """Until a fault is known, and the vehicle has slowed to a stand from which it may go on."""
    return lambda config: after(config) + _slowed(config, config.safety.halt_mps2)


def halted(config: Vehicle4ws4wdConfig) -> int:
    """Until a vehicle that is not asked to drive any more has slowed down."""
    return 2 * config.loops.tracker_period_ns + _slowed(config, config.tracker.following.speed.deceleration_mps2)


def state_missing(config: Vehicle4ws4wdConfig) -> int:
    """Until the last state frame is too old, which came up to a tick after it was made."""
    return config.safety.state_age_max_ns + 2 * config.loops.drive_period_ns


def temperature_read(config: Vehicle4ws4wdConfig) -> int:
    """Until the unit tells temperatures again."""
    return config.simulation.temperature_period_ns + 2 * config.loops.drive_period_ns


def imu_frozen(config: Vehicle4ws4wdConfig) -> int:
    """Until too many samples, of which each tick sees one, are alike."""
    return (config.safety.imu_frozen_samples + 1) * config.loops.drive_period_ns


def imu_missing(config: Vehicle4ws4wdConfig) -> int:
    """Until a tick finds the last sample too old."""
    return imu_stale(config) + config.loops.drive_period_ns


def refused(config: Vehicle4ws4wdConfig) -> int:
    """Until the unit has not driven for too long though it was told to."""
    return config.safety.refusal_ns + 3 * config.loops.drive_period_ns


def commands_refused(config: Vehicle4ws4wdConfig) -> int:
    """The same of a unit that first has to give up waiting."""
    return config.simulation.command_timeout_ns + refused(config)


def stuck(config: Vehicle4ws4wdConfig) -> int:
    """Until a wheel that is stuck where a bend begins is late where the next begins, and has been late too long."""
    bend_s = 2.0 * arc(45.0).length / config.scenario.speed_mps
    turning_s = 2.0 * config.safety.steering_error_rad / config.simulation.steering_rate_radps
    return round((bend_s + turning_s) * 1e9) + config.safety.steering_stuck_ns + ANSWER_NS


def overrun(count: int) -> Bound:
    """Until so many ticks have overrun by one period each."""
    return ticks(2 * count + 2)


def twist_old(config: Vehicle4ws4wdConfig) -> int:
    """Until the tracker's last command is too old."""
    return config.safety.command_age_max_ns + 2 * config.loops.drive_period_ns
