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
from runtime.safety.answers import POWERED
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
    Motion,
    OperatorRequest,
    SafetyStatus,
)
from runtime.tasks import Task
from runtime.vehicle_signals import TwistCommand, VehicleState, WheelCommand, WheelState

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
        drive_mode, brake_mode: how the unit counts the modes in which it obeys, and in which it brakes.
        period_ns: of the loop.
        imu, wheels, body, battery, buses, timing, operator, twist, command: records read.
        output, status: records written.
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
    ) -> None:
        self._config, self._drive_mode, self._brake_mode = config, drive_mode, brake_mode
        self._body, self._operator, self._command, self._output, self._status = body, operator, command, output, status
        watched = (imu, wheels, body, battery, buses, timing, operator, twist, command)
        self.reads, self.writes = watched, (output, status)
        self.state: VehicleSafetyMemory = VehicleSafetyMemory("/ugv/state/safety", {**output.sizes, **buses.sizes})
        parameters, tables = table_of(config), [record.table for record in watched]
        slow = np.array(slow_frames, dtype=np.bool_)
        inputs = VehicleInputs(*tables)  # type: ignore[arg-type]
        self._faults = partial(vehicle_faults, parameters, table_of(inertial), radius, slow, self.state.table, inputs)
        step_s = period_ns * 1e-9
        self._follow = partial(_follow, parameters, radius, step_s, command.table, self.state.table)
        self._slow_down = partial(_slow_down, parameters, radius, step_s, wheels.table, self.state.table)
        self._brake = partial(_brake, wheels.table, self.state.table)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, status = self.state, self._status
        found = self._faults(now_ns)
        before = Mode(memory.mode)
        mode = self._next_mode(before, found)
        if mode == Mode.DAMPED and before != Mode.DAMPED:
            memory.fault, memory.faults, memory.stop_ns = found, memory.faults + 1, now_ns
            memory.braked = before not in POWERED
        elif mode != Mode.DAMPED:
            memory.fault = 0
        memory.mode = mode
        self._command_wheels(before, mode, found, now_ns)
        status.stamp_ns, status.mode, status.warning = now_ns, mode, found
        status.fault, status.limited, status.faults = memory.fault, memory.limited, memory.faults
        status.halt, status.coasted = found & VEHICLE_HALTS, memory.coasted

    def _next_mode(self, mode: Mode, found: int) -> Mode:
        operator, resting = self._operator, self._body.resting
        motion = Motion(operator.motion)
        return next_mode(
            mode,
            vehicle_health(found),
            operator.arm,
            operator.reset and resting,
            motion,
            vehicle_stance(resting, motion),
            not resting,
        )

    def _command_wheels(self, before: Mode, mode: Mode, found: int, now_ns: int) -> None:
        """Follow the command, slow down in an order or with the brakes, and say so."""
        memory, output, config = self.state, self._output, self._config
        stops = mode == Mode.DAMPED and not memory.braked
        powered = mode in POWERED and before in POWERED
        if stops:
            stopped = self._slow_down(config.brake_mps2, memory.steering)
            memory.braked = stopped or now_ns - memory.stop_ns > config.stop_max_ns
        elif powered and mode == Mode.ACTIVE and not found & VEHICLE_HALTS:
            self._follow()
        elif powered:
            fresh = mode == Mode.ACTIVE and not found & Fault.STALE_BODY_COMMAND
            self._slow_down(config.halt_mps2, self._command.steering if fresh else memory.steering)
        else:
            self._brake()
        output.stamp_ns, output.enable = now_ns, stops or powered
        output.mode = self._drive_mode if output.enable else self._brake_mode
        output.steering, output.speed = memory.steering, memory.speed
        output.manner, output.phase = self._command.manner, self._command.phase


@compiled
def _follow(
    configs: Sequence[VehicleSafetyConfig],
    radius: float,
    step_s: float,
    commands: Sequence[WheelCommand],
    memories: Sequence[VehicleSafetyMemory],
) -> None:
    """The command within its limits; what limits one wheel slows the others in proportion, so that none drags."""
    config, command, memory = configs[0], commands[0], memories[0]
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
    configs: Sequence[VehicleSafetyConfig],
    radius: float,
    step_s: float,
    all_wheels: Sequence[WheelState],
    memories: Sequence[VehicleSafetyMemory],
    deceleration: float,
    steering: Array,
) -> bool:
    """Slow all wheels alike, with the given angles; whether they have stopped."""
    config, wheels, memory = configs[0], all_wheels[0], memories[0]
    bound = config.steering_max_rad
    angles = straight(steering, wheels.steering, memory.speed, memory.stuck)
    angles = np.minimum(np.maximum(angles, -bound), bound)
    memory.steering[:] = approached(memory.steering, angles, config.steering_rate_max_radps * step_s)
    memory.speed[:] = approached(memory.speed, np.zeros_like(memory.speed), deceleration * step_s / radius)
    return bool((memory.speed == 0.0).all() and (np.abs(wheels.speed) <= STILL_RADPS).all())


@compiled
def _brake(all_wheels: Sequence[WheelState], memories: Sequence[VehicleSafetyMemory]) -> None:
    """No speed, and the angles at which the wheels are."""
    wheels, memory = all_wheels[0], memories[0]
    memory.speed[:] = 0.0
    for wheel in range(memory.steering.shape[0]):
        if math.isfinite(wheels.steering[wheel]):
            memory.steering[wheel] = wheels.steering[wheel]
