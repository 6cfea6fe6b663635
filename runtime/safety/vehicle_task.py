# SPDX-License-Identifier: Apache-2.0
"""The last task before a vehicle's control unit: limits every command, and answers when something is wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.models.inertial import InertialConfig
from runtime.safety.answers import is_powered
from runtime.safety.state_machine import next_mode
from runtime.safety.vehicle_answers import VEHICLE_HALTS, approached, straight, vehicle_health, vehicle_stance
from runtime.safety.vehicle_config import VehicleSafetyConfig
from runtime.safety.vehicle_watch import VehicleInputs, VehicleSafetyMemory, vehicle_faults
from runtime.signals import (
    Battery,
    BusStatus,
    Fault,
    Imu,
    LoopTiming,
    Mode,
    OperatorRequest,
    SafetyStatus,
)
from runtime.tasks import Task
from runtime.vehicle_signals import TwistCommand, VehicleState, WheelCommand, WheelState, WheelStatus

Array = npt.NDArray[np.float64]
STILL_RADPS = 0.1
"""Speed of a wheel that has stopped."""


class VehicleSafetyTask(Task):
    """Filters the wheels' command.

    Args:
        config: limits.
        inertial: what an inertial sample may be.
        radius: of the wheels, m.
        slow_frames: of each of the unit's state frames, whether it comes seldom.
        drive_mode: asks the unit to drive, as it counts them.
        brake_mode: asks it to brake.
        driving_mode: is what it reports while it drives.
        period_ns: of the loop.
        imu, wheels, body, battery, buses, timing, operator, twist, command: records read.
        output, status, wheel_status: records written.
    """

    name = "safety"

    def __init__(
        self,
        config: VehicleSafetyConfig,
        inertial: InertialConfig,
        radius: float,
        slow_frames: Sequence[bool],
        drive_mode: int,
        brake_mode: int,
        driving_mode: int,
        period_ns: int,
        imu: Imu,
        wheels: WheelState,
        body: VehicleState,
        battery: Battery,
        buses: BusStatus,
        timing: LoopTiming,
        operator: OperatorRequest,
        twist: TwistCommand,
        command: WheelCommand,
        output: WheelCommand,
        status: SafetyStatus,
        wheel_status: WheelStatus,
    ) -> None:
        watched = (imu, wheels, body, battery, buses, timing, operator, twist, command)
        self.reads, self.writes = watched, (output, status, wheel_status)
        self.state: VehicleSafetyMemory = VehicleSafetyMemory("/ugv/state/safety", {**output.sizes, **buses.sizes})
        inputs = VehicleInputs(
            imu.table,
            wheels.table,
            body.table,
            battery.table,
            buses.table,
            timing.table,
            operator.table,
            twist.table,
            command.table,
        )
        self._pass = partial(
            _pass,
            table_of(config),
            table_of(inertial),
            radius,
            np.array(slow_frames, dtype=np.bool_),
            (drive_mode, brake_mode, driving_mode),
            period_ns * 1e-9,
            inputs,
            self.state.table,
            output.table,
            status.table,
            wheel_status.table,
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        self._pass(now_ns)


@compiled
def _pass(
    configs: Sequence[VehicleSafetyConfig],
    inertials: Sequence[InertialConfig],
    radius: float,
    slow: npt.NDArray[np.bool_],
    unit_modes: tuple[int, int, int],
    step_s: float,
    inputs: VehicleInputs,
    memories: Sequence[VehicleSafetyMemory],
    outputs: Sequence[WheelCommand],
    statuses: Sequence[SafetyStatus],
    wheel_statuses: Sequence[WheelStatus],
    now_ns: int,
) -> None:
    """Look for faults, decide on the mode, and pass the command on as far as it may be."""
    config, memory, output, status = configs[0], memories[0], outputs[0], statuses[0]
    found = vehicle_faults(config, inertials[0], radius, slow, unit_modes[2], memory, inputs, now_ns)
    before = int(memory.mode)
    mode = _next_mode(before, found, inputs.operator[0], inputs.body[0].resting)
    if mode == Mode.DAMPED and before != Mode.DAMPED:
        memory.fault, memory.faults, memory.stop_ns = found, memory.faults + 1, now_ns
        memory.braked = not is_powered(before)
    elif mode != Mode.DAMPED:
        memory.fault = 0
    memory.mode = mode
    stops, powered = mode == Mode.DAMPED and not memory.braked, is_powered(mode) and is_powered(before)
    if stops:
        stopped = _slow_down(config, radius, step_s, inputs, memory, config.brake_mps2, memory.steering)
        memory.braked = stopped or now_ns - memory.stop_ns > config.stop_max_ns
    elif powered:
        _go_on(config, radius, step_s, inputs, memory, found)
    else:
        _brake(inputs.wheels[0], memory)
    _publish(unit_modes, inputs.command[0], memory, output, stops or powered, now_ns)
    status.stamp_ns, status.mode, status.warning = now_ns, mode, found
    status.fault, status.limited, status.faults = memory.fault, memory.limited, memory.faults
    status.halt, status.coasted = found & VEHICLE_HALTS, memory.coasted
    wheel_statuses[0].stamp_ns, wheel_statuses[0].stuck[:] = now_ns, memory.stuck


@compiled
def _next_mode(mode: int, found: int, operator: OperatorRequest, resting: bool) -> int:
    """The state machine of every robot; a vehicle leaves DAMPED at rest only."""
    motion = int(operator.motion)
    stance, reset = vehicle_stance(resting, motion), operator.reset and resting
    return next_mode(mode, vehicle_health(found), operator.arm, reset, motion, stance, not resting)


@compiled
def _go_on(
    config: VehicleSafetyConfig,
    radius: float,
    step_s: float,
    inputs: VehicleInputs,
    memory: VehicleSafetyMemory,
    found: int,
) -> None:
    """Follow the command, or slow to a stand, along the commanded bend if that is of the present."""
    command = inputs.command[0]
    if memory.mode == Mode.ACTIVE and not found & VEHICLE_HALTS:
        _follow(config, radius, step_s, command, memory)
    elif memory.mode == Mode.ACTIVE and not found & Fault.STALE_BODY_COMMAND.value:
        _slow_down(config, radius, step_s, inputs, memory, config.halt_mps2, command.steering)
    else:
        _slow_down(config, radius, step_s, inputs, memory, config.halt_mps2, memory.steering)


@compiled
def _publish(
    unit_modes: tuple[int, int, int],
    command: WheelCommand,
    memory: VehicleSafetyMemory,
    output: WheelCommand,
    enable: bool,
    now_ns: int,
) -> None:
    output.stamp_ns, output.enable = now_ns, enable
    output.mode = unit_modes[0] if enable else unit_modes[1]
    output.steering[:] = memory.steering
    output.speed[:] = memory.speed
    output.manner, output.phase = command.manner, command.phase


@compiled
def _follow(
    config: VehicleSafetyConfig, radius: float, step_s: float, command: WheelCommand, memory: VehicleSafetyMemory
) -> None:
    """The command within its limits; what limits one wheel slows the others in proportion, so that none drags."""
    bound = config.steering_max_rad
    fastest = radius * np.abs(command.speed).max()
    scale = config.speed_max_mps / fastest if fastest > config.speed_max_mps else 1.0
    angles = np.minimum(np.maximum(command.steering, -bound), bound)
    memory.steering[:] = approached(memory.steering, angles, config.steering_rate_max_radps * step_s)
    memory.speed[:] = approached(memory.speed, scale * command.speed, config.acceleration_max_mps2 * step_s / radius)
    for wheel in range(angles.shape[0]):
        memory.limited += memory.steering[wheel] != command.steering[wheel]
        memory.limited += memory.speed[wheel] != command.speed[wheel]


@compiled
def _slow_down(
    config: VehicleSafetyConfig,
    radius: float,
    step_s: float,
    inputs: VehicleInputs,
    memory: VehicleSafetyMemory,
    deceleration: float,
    steering: Array,
) -> bool:
    """Slow all wheels alike, with the given angles; whether they have stopped."""
    wheels, bound = inputs.wheels[0], config.steering_max_rad
    angles = straight(steering, wheels.steering, memory.speed, memory.stuck)
    angles = np.minimum(np.maximum(angles, -bound), bound)
    memory.steering[:] = approached(memory.steering, angles, config.steering_rate_max_radps * step_s)
    memory.speed[:] = approached(memory.speed, np.zeros_like(memory.speed), deceleration * step_s / radius)
    return bool((memory.speed == 0.0).all() and (np.abs(wheels.speed) <= STILL_RADPS).all())


@compiled
def _brake(wheels: WheelState, memory: VehicleSafetyMemory) -> None:
    """No speed, and the angles at which the wheels are."""
    memory.speed[:] = 0.0
    for wheel in range(memory.steering.shape[0]):
        if math.isfinite(wheels.steering[wheel]):
            memory.steering[wheel] = wheels.steering[wheel]
