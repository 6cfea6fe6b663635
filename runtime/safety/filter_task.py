# SPDX-License-Identifier: Apache-2.0
"""The last task before the drives: limits every command, and answers when something is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.models.inertial import InertialConfig
from runtime.safety.answers import HALTS, derating_faults, health_of, is_down, is_powered
from runtime.safety.config import SafetyConfig
from runtime.safety.limits import joint_bounds, within
from runtime.safety.state_machine import Health, next_mode
from runtime.safety.watch import Inputs, SafetyMemory, faults
from runtime.signals import (
    Battery,
    BodyCommand,
    BodyState,
    BusStatus,
    ContactForces,
    Gait,
    Imu,
    JointCommand,
    JointState,
    LoopTiming,
    Mode,
    OperatorRequest,
    Posture,
    SafetyStatus,
)
from runtime.tasks import Task

Array = npt.NDArray[np.float64]


class SafetyTask(Task):
    """Filters the joint command.

    Args:
        config: limits.
        inertial: what an inertial sample may be.
        period_ns: of the loop.
        imu, joints, body, battery, buses, timing, operator, posture, gait, body_command, forces, command: records read.
        output, status: records written.
    """

    name = "safety"

    def __init__(
        self,
        config: SafetyConfig,
        inertial: InertialConfig,
        period_ns: int,
        imu: Imu,
        joints: JointState,
        body: BodyState,
        battery: Battery,
        buses: BusStatus,
        timing: LoopTiming,
        operator: OperatorRequest,
        posture: Posture,
        gait: Gait,
        body_command: BodyCommand,
        forces: ContactForces,
        command: JointCommand,
        output: JointCommand,
        status: SafetyStatus,
    ) -> None:
        watched = (imu, joints, body, battery, buses, timing, operator, body_command, gait, forces, command, posture)
        self.reads, self.writes = watched, (output, status)
        self.state: SafetyMemory = SafetyMemory("/ugv/state/safety", output.sizes)
        inputs = Inputs(
            imu.table,
            joints.table,
            body.table,
            battery.table,
            buses.table,
            timing.table,
            operator.table,
            body_command.table,
            gait.table,
            forces.table,
            command.table,
            posture.table,
        )
        self._pass = partial(
            _pass,
            table_of(config),
            table_of(inertial),
            *joint_bounds(config),
            config.effort_rate_max_nmps * period_ns * 1e-9,
            derating_faults(config),
            inputs,
            self.state.table,
            output.table,
            status.table,
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        self._pass(now_ns)


@compiled
def _pass(
    configs: Sequence[SafetyConfig],
    inertials: Sequence[InertialConfig],
    low: Array,
    high: Array,
    effort_step: float,
    derating: int,
    inputs: Inputs,
    memories: Sequence[SafetyMemory],
    outputs: Sequence[JointCommand],
    statuses: Sequence[SafetyStatus],
    now_ns: int,
) -> None:
    """Look for faults, decide on the mode, and pass the command on as far as it may be."""
    config, memory, status = configs[0], memories[0], statuses[0]
    found = faults(config, inertials[0], low, high, memory, inputs, now_ns)
    before = int(memory.mode)
    tolerated = _derate(config, memory, derating, before, found, now_ns)
    operator = inputs.operator[0]
    mode = next_mode(
        before,
        _health(config, memory, before, found, tolerated, now_ns),
        operator.arm,
        operator.reset,
        int(operator.motion),
        int(inputs.posture[0].stance),
        inputs.gait[0].walking,
    )
    if is_down(mode) and not is_down(before):
        memory.fault, memory.faults, memory.crouch_ns = found, memory.faults + 1, now_ns
    elif mode == Mode.DAMPED and before == Mode.CROUCHING:
        memory.fault |= found
    elif not is_down(mode):
        memory.fault = 0
    memory.mode = mode
    powered = is_powered(mode) and is_powered(before)
    _filter(config, low, high, effort_step, inputs, memory, outputs[0], now_ns, powered)
    status.stamp_ns, status.mode, status.warning = now_ns, mode, found
    status.fault, status.limited, status.faults = memory.fault, memory.limited, memory.faults
    status.halt, status.coasted = found & HALTS | memory.derated, memory.coasted
    status.derated = memory.derated != 0


@compiled
def _health(config: SafetyConfig, memory: SafetyMemory, mode: int, found: int, tolerated: int, now_ns: int) -> int:
    if mode == Mode.CROUCHING and now_ns - memory.crouch_ns > config.crouch_max_ns:
        return Health.UNFIT.value
    return health_of(found, mode, tolerated)


@compiled
def _derate(config: SafetyConfig, memory: SafetyMemory, derating: int, mode: int, found: int, now_ns: int) -> int:
    """Keep account of the faults that the robot is derated for; those that are tolerated yet."""
    present = found & derating
    if not is_powered(mode):
        memory.derated = 0
        return 0
    if present:
        if memory.derated == 0:
            memory.derate_ns = now_ns
        memory.derated |= present
        memory.derate_seen_ns = now_ns
    elif now_ns - memory.derate_seen_ns > config.derate_clear_ns:
        memory.derated = 0
    expired = memory.derated != 0 and now_ns - memory.derate_ns > config.derate_ns
    return 0 if expired else derating


@compiled
def _filter(
    config: SafetyConfig,
    low: Array,
    high: Array,
    effort_step: float,
    inputs: Inputs,
    memory: SafetyMemory,
    output: JointCommand,
    now_ns: int,
    powered: bool,
) -> None:
    """The command within its limits; or without power no stiffness, no torque, and velocity damping."""
    command = inputs.command[0]
    output.stamp_ns = now_ns
    if not powered:
        output.position[:] = inputs.joints[0].position
        output.velocity[:] = 0.0
        output.effort[:] = 0.0
        output.stiffness[:] = 0.0
        output.damping[:] = config.damping_nms_prad
        memory.effort[:] = 0.0
        return
    one, joints = np.ones(low.shape[0]), inputs.joints[0]
    fastest = config.velocity_max_radps * one
    strongest = (config.derated_effort_nm if memory.derated != 0 else config.effort_max_nm) * one
    altered = within(command.position, low, high, output.position)
    altered += within(command.velocity, -fastest, fastest, output.velocity)
    altered += within(command.stiffness, 0.0 * one, config.stiffness_max_nm_prad * one, output.stiffness)
    altered += within(command.damping, 0.0 * one, config.damping_max_nms_prad * one, output.damping)
    held = output.stiffness * (output.position - joints.position) + output.damping * (output.velocity - joints.velocity)
    lowest = np.maximum(-strongest, np.minimum(strongest, -strongest - held))
    highest = np.maximum(-strongest, np.minimum(strongest, strongest - held))
    slowest = np.maximum(lowest, np.minimum(highest, memory.effort - effort_step))
    quickest = np.maximum(lowest, np.minimum(highest, memory.effort + effort_step))
    altered += within(command.effort, slowest, quickest, output.effort)
    memory.limited += altered
    memory.effort[:] = output.effort
