# SPDX-License-Identifier: Apache-2.0
"""Looks for what is wrong with a vehicle on steered wheels and with its commands; finds bits of `Fault`.

A wheel takes the place of a joint: JOINT_VELOCITY is one that turns too fast, STALE_MOTOR a state frame that no longer
comes, MOTOR_FAULT what the control unit says of its motors, or that it does not drive them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.models.inertial import InertialConfig
from runtime.records import boolean, boolean_array, float64_array, int64, int64_array, uint32
from runtime.safety.answers import is_powered
from runtime.safety.common_watch import (
    WatchMemory,
    battery_faults,
    bus_faults,
    estimate_faults,
    inertial_faults,
    loop_faults,
    operator_faults,
    standstill_faults,
)
from runtime.safety.vehicle_config import VehicleSafetyConfig
from runtime.signals import Battery, BusStatus, Fault, Imu, LoopTiming, Mode, OperatorRequest
from runtime.vehicle_signals import TwistCommand, VehicleState, WheelCommand, WheelState

Mask = npt.NDArray[np.bool_]


class VehicleSafetyMemory(WatchMemory):
    """What the filter must remember."""

    coasted = uint32("", "state frames that were late, summed over ticks")
    steering = float64_array("wheel", "rad", "of the last command")
    speed = float64_array("wheel", "rad/s", "of the last command")
    stop_ns = int64("ns", "when stopping for good began")
    idle_ns = int64("ns", "when the vehicle last did not follow the tracker")
    braked = boolean("the brakes are on, and stay so")
    angle = float64_array("wheel", "rad", "at which each wheel last was seen to turn, or to be where it should")
    turned_ns = int64_array("wheel", "ns", "when that was")
    driven_ns = int64("ns", "when the unit last drove, or was not to")
    stuck = boolean_array("wheel", "the steering did not follow")


class VehicleInputs(NamedTuple):
    """Everything that the filter reads, each as the table of a record."""

    imu: Sequence[Imu]
    wheels: Sequence[WheelState]
    body: Sequence[VehicleState]
    battery: Sequence[Battery]
    buses: Sequence[BusStatus]
    timing: Sequence[LoopTiming]
    operator: Sequence[OperatorRequest]
    twist: Sequence[TwistCommand]
    command: Sequence[WheelCommand]


@compiled
def vehicle_faults(
    config: VehicleSafetyConfig,
    inertial: InertialConfig,
    radius: float,
    slow: Mask,
    drives: int,
    memory: VehicleSafetyMemory,
    inputs: VehicleInputs,
    now_ns: int,
) -> int:
    """Everything that is wrong, as bits of `Fault`.

    Args:
        config: limits.
        inertial: what an inertial sample may be.
        radius: of the wheels, m.
        slow: which of the unit's state frames come seldom.
        drives: the mode that the unit reports while it drives.
        memory: of the filter.
        inputs: of the filter.
        now_ns: time.
    """
    wheels, powered = inputs.wheels[0], is_powered(memory.mode)
    found = inertial_faults(config, inertial, memory, inputs.imu[0], now_ns)
    found |= frame_faults(config, memory, wheels, slow, now_ns)
    found |= wheel_faults(config, wheels, radius)
    found |= refusal_faults(config, memory, powered and wheels.mode != drives, now_ns)
    found |= steering_faults(config, memory, wheels, powered, now_ns)
    found |= bus_faults(memory, inputs.buses[0])
    found |= estimate_faults(config, inputs.body[0])
    found |= battery_faults(config, inputs.battery[0])
    found |= loop_faults(config, memory, inputs.timing[0], now_ns)
    found |= command_faults(config, memory, inputs.twist[0], inputs.command[0], now_ns)
    if powered:
        found |= operator_faults(config, inputs.operator[0], now_ns)
        found |= standstill_faults(config, inputs.timing[0])
    if inputs.operator[0].emergency_stop:
        found |= Fault.EMERGENCY_STOP.value
    return found


@compiled
def frame_faults(
    config: VehicleSafetyConfig, memory: VehicleSafetyMemory, wheels: WheelState, slow: Mask, now_ns: int
) -> int:
    """State frames that are late, or come no more."""
    found = 0
    for frame in range(slow.shape[0]):
        age_ns = now_ns - wheels.reply_ns[frame]
        longest_ns = config.slow_state_age_max_ns if slow[frame] else config.state_age_max_ns
        if wheels.reply_ns[frame] == 0 or age_ns > longest_ns:
            found |= Fault.STALE_MOTOR.value
        elif age_ns > config.state_late_ns and not slow[frame]:
            memory.coasted += 1
            found |= Fault.MISSING_REPLY.value
    return found


@compiled
def wheel_faults(config: VehicleSafetyConfig, wheels: WheelState, radius: float) -> int:
    """What the unit says of its motors, and what its readings say."""
    found = 0
    if wheels.fault.any():
        found |= Fault.MOTOR_FAULT.value
    if (wheels.temperature > config.temperature_max_degc).any():
        found |= Fault.TEMPERATURE.value
    fastest = (config.speed_max_mps + config.speed_margin_mps) / radius
    for wheel in range(wheels.speed.shape[0]):
        if not (math.isfinite(wheels.speed[wheel]) and math.isfinite(wheels.steering[wheel])):
            found |= Fault.NON_FINITE_SENSOR.value
        elif abs(wheels.speed[wheel]) > fastest:
            found |= Fault.JOINT_VELOCITY.value
    return found


@compiled
def refusal_faults(config: VehicleSafetyConfig, memory: VehicleSafetyMemory, refused: bool, now_ns: int) -> int:
    """A unit that does not do as it is told for too long, as after commands that reached it damaged."""
    if not refused:
        memory.driven_ns = now_ns
    return Fault.MOTOR_FAULT.value if now_ns - memory.driven_ns > config.refusal_ns else 0


@compiled
def steering_faults(
    config: VehicleSafetyConfig, memory: VehicleSafetyMemory, wheels: WheelState, powered: bool, now_ns: int
) -> int:
    """Wheels that are told to turn and do not, or cannot by the unit's own word; they stay known while it stops."""
    found = 0
    for wheel in range(wheels.steering.shape[0]):
        angle = wheels.steering[wheel]
        follows = abs(angle - memory.steering[wheel]) <= config.steering_error_rad
        if not powered or follows or abs(angle - memory.angle[wheel]) >= config.steering_step_rad:
            memory.angle[wheel], memory.turned_ns[wheel] = angle, now_ns
        if powered:
            late = now_ns - memory.turned_ns[wheel] > config.steering_stuck_ns
            memory.stuck[wheel] = late or wheels.fault[wheel] != 0
            if memory.stuck[wheel]:
                found |= Fault.STUCK_STEERING.value
    return found


@compiled
def command_faults(
    config: VehicleSafetyConfig, memory: VehicleSafetyMemory, twist: TwistCommand, command: WheelCommand, now_ns: int
) -> int:
    """A command that is no number, or old while the vehicle follows it."""
    found = 0
    if not (np.isfinite(command.steering).all() and np.isfinite(command.speed).all()):
        found |= Fault.NON_FINITE_COMMAND.value
    if memory.mode != Mode.ACTIVE:
        memory.idle_ns = now_ns
    oldest_ns = max(min(twist.stamp_ns, command.stamp_ns), memory.idle_ns)
    if now_ns - oldest_ns > config.command_age_max_ns:
        found |= Fault.STALE_BODY_COMMAND.value
    return found
