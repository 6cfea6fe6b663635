# SPDX-License-Identifier: Apache-2.0
"""The last task before the drives: limits every command, and damps the robot when something is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.records import Record, float64_array, int64, uint8, uint32
from runtime.safety.limits import SafetyConfig, is_finite, is_finite_sample, joint_bounds, sensor_faults, within
from runtime.safety.state_machine import next_mode
from runtime.signals import (
    Battery,
    BodyState,
    ContactForces,
    Fault,
    Gait,
    Imu,
    JointCommand,
    JointState,
    Mode,
    Motion,
    OperatorRequest,
    Posture,
    SafetyStatus,
    Stance,
)
from runtime.tasks import Task

Array = npt.NDArray[np.float64]
WARNINGS = (Fault.NON_FINITE_SENSOR | Fault.STALE_LOCALIZATION).value
"""Conditions that are reported but do not damp: the estimator bridges them."""
POWERED = (Mode.STANDING, Mode.ACTIVE)


class SafetyMemory(Record):
    """What the filter must remember."""

    mode = uint8()
    imu_ns = int64("ns", "stamp of the last finite inertial sample")
    fault = uint32()
    limited = uint32()
    faults = uint32()
    effort = float64_array("joint", "N.m", "of the last command")


class SafetyTask(Task):
    """Filters the joint command.

    Args:
        config: limits.
        period_ns: of the loop.
        imu, joints, body, battery, operator, posture, gait, forces, command: records read.
        output, status: records written.
    """

    name = "safety"

    def __init__(
        self,
        config: SafetyConfig,
        period_ns: int,
        imu: Imu,
        joints: JointState,
        body: BodyState,
        battery: Battery,
        operator: OperatorRequest,
        posture: Posture,
        gait: Gait,
        forces: ContactForces,
        command: JointCommand,
        output: JointCommand,
        status: SafetyStatus,
    ) -> None:
        self._operator, self._posture, self._status = operator, posture, status
        self.reads = (imu, joints, body, battery, operator, posture, gait, forces, command)
        self.writes = (output, status)
        self.state: SafetyMemory = SafetyMemory("/ugv/state/safety", output.sizes)
        limits = table_of(config), *joint_bounds(config)
        self._faults = partial(
            _faults,
            *limits,
            self.state.table,
            imu.table,
            joints.table,
            body.table,
            battery.table,
            operator.table,
            gait.table,
            forces.table,
            command.table,
        )
        effort_step = config.effort_rate_max_nmps * period_ns * 1e-9
        self._filter = partial(
            _filter, *limits, effort_step, joints.table, command.table, self.state.table, output.table
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, operator, status = self.state, self._operator, self._status
        found = self._faults(now_ns)
        before = memory.mode
        mode = next_mode(
            Mode(before),
            not found & ~WARNINGS,
            operator.arm,
            operator.reset,
            Motion(operator.motion),
            Stance(self._posture.stance),
        )
        if mode == Mode.DAMPED and before != Mode.DAMPED:
            memory.fault, memory.faults = found, memory.faults + 1
        elif mode != Mode.DAMPED:
            memory.fault = 0
        memory.mode = mode
        self._filter(now_ns, mode in POWERED and before in POWERED)
        status.stamp_ns, status.mode, status.warning = now_ns, mode, found
        status.fault, status.limited, status.faults = memory.fault, memory.limited, memory.faults


@compiled
def _faults(
    configs: Sequence[SafetyConfig],
    low: Array,
    high: Array,
    memories: Sequence[SafetyMemory],
    samples: Sequence[Imu],
    all_joints: Sequence[JointState],
    bodies: Sequence[BodyState],
    batteries: Sequence[Battery],
    operators: Sequence[OperatorRequest],
    gaits: Sequence[Gait],
    plans: Sequence[ContactForces],
    commands: Sequence[JointCommand],
    now_ns: int,
) -> int:
    """What is wrong with the inputs, the commands, and the posture they were made for, as bits of `Fault`."""
    config, memory, imu, joints = configs[0], memories[0], samples[0], all_joints[0]
    finite = is_finite_sample(imu)
    if finite:
        memory.imu_ns = imu.stamp_ns
    found = sensor_faults(config, now_ns, memory.imu_ns, joints, bodies[0], batteries[0].voltage)
    if not finite:
        found |= Fault.NON_FINITE_SENSOR.value
    if not is_finite(commands[0]):
        found |= Fault.NON_FINITE_COMMAND.value
    powered = memory.mode == Mode.STANDING or memory.mode == Mode.ACTIVE
    for joint in range(low.shape[0]):
        beyond = max(joints.position[joint] - high[joint], low[joint] - joints.position[joint])
        if powered and not beyond <= config.position_margin_rad:
            found |= Fault.JOINT_POSITION.value
    if gaits[0].walking and now_ns - plans[0].stamp_ns > config.forces_age_max_ns:
        found |= Fault.STALE_FORCES.value
    if now_ns - operators[0].stamp_ns > config.command_age_max_ns:
        found |= Fault.STALE_BODY_COMMAND.value
    return found


@compiled
def _filter(
    configs: Sequence[SafetyConfig],
    low: Array,
    high: Array,
    effort_step: float,
    all_joints: Sequence[JointState],
    commands: Sequence[JointCommand],
    memories: Sequence[SafetyMemory],
    outputs: Sequence[JointCommand],
    now_ns: int,
    powered: bool,
) -> None:
    """The command within its limits; or without power no stiffness, no torque, and velocity damping."""
    config, command, memory, output = configs[0], commands[0], memories[0], outputs[0]
    output.stamp_ns = now_ns
    if not powered:
        output.position[:] = all_joints[0].position
        output.velocity[:] = 0.0
        output.effort[:] = 0.0
        output.stiffness[:] = 0.0
        output.damping[:] = config.damping_nms_prad
        memory.effort[:] = 0.0
        return
    one = np.ones(low.shape[0])
    strongest, fastest = config.effort_max_nm * one, config.velocity_max_radps * one
    lowest = np.maximum(-strongest, np.minimum(strongest, memory.effort - effort_step))
    highest = np.maximum(-strongest, np.minimum(strongest, memory.effort + effort_step))
    altered = within(command.position, low, high, output.position)
    altered += within(command.velocity, -fastest, fastest, output.velocity)
    altered += within(command.effort, lowest, highest, output.effort)
    altered += within(command.stiffness, 0.0 * one, config.stiffness_max_nm_prad * one, output.stiffness)
    altered += within(command.damping, 0.0 * one, config.damping_max_nms_prad * one, output.damping)
    memory.limited += altered
    memory.effort[:] = output.effort
