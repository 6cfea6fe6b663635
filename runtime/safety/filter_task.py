# SPDX-License-Identifier: Apache-2.0
"""The last task before the drives: limits every command, and damps the robot when something is wrong."""

from __future__ import annotations

from operator import ne

import numpy as np

from runtime.records import Record, float64_array, int64, uint8, uint32
from runtime.safety.limits import SafetyConfig, is_finite, is_finite_sample, joint_bounds, sensor_faults
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

WARNINGS = Fault.NON_FINITE_SENSOR | Fault.STALE_LOCALIZATION
"""Conditions that are reported but do not damp: the estimator bridges them."""
POWERED = (Mode.STANDING, Mode.ACTIVE)
LIMITED = ("position", "velocity", "effort", "stiffness", "damping")


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
        self._config = config
        self._imu, self._joints, self._body, self._battery = imu, joints, body, battery
        self._operator, self._posture, self._gait, self._forces = operator, posture, gait, forces
        self._command, self._output, self._status = command, output, status
        self._low, self._high = joint_bounds(config)
        self._effort_step = config.effort_rate_max_nmps * period_ns * 1e-9
        self.reads = (imu, joints, body, battery, operator, posture, gait, forces, command)
        self.writes = (output, status)
        self.state: SafetyMemory = SafetyMemory("/ugv/state/safety", output.sizes)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, config, operator = self.state, self._config, self._operator
        finite = is_finite_sample(self._imu)
        if finite:
            memory.imu_ns = self._imu.stamp_ns
        found = sensor_faults(config, now_ns, memory.imu_ns, self._joints, self._body, self._battery.voltage)
        if not finite:
            found |= Fault.NON_FINITE_SENSOR
        found |= self._command_faults(now_ns)
        before = Mode(memory.mode)
        mode = next_mode(
            before,
            not found & ~WARNINGS,
            operator.arm,
            operator.reset,
            Motion(operator.motion),
            Stance(self._posture.stance),
        )
        if mode == Mode.DAMPED and before != Mode.DAMPED:
            memory.fault, memory.faults = int(found), memory.faults + 1
        elif mode != Mode.DAMPED:
            memory.fault = 0
        memory.mode = mode
        if mode in POWERED and before in POWERED:
            self._pass_on()
        else:
            self._damp()
        self._output.stamp_ns = now_ns
        status = self._status
        status.stamp_ns, status.mode, status.warning = now_ns, mode, int(found)
        status.fault, status.limited, status.faults = memory.fault, memory.limited, memory.faults

    def _command_faults(self, now_ns: int) -> Fault:
        """What is wrong with the commands, and with the posture they were made for."""
        config, joints, fault = self._config, self._joints, Fault.NONE
        if not is_finite(self._command):
            fault |= Fault.NON_FINITE_COMMAND
        margin = config.position_margin_rad
        beyond = np.maximum(joints.position - self._high, self._low - joints.position)
        if self.state.mode in POWERED and not float(beyond.max()) <= margin:
            fault |= Fault.JOINT_POSITION
        if self._gait.walking and now_ns - self._forces.stamp_ns > config.forces_age_max_ns:
            fault |= Fault.STALE_FORCES
        if now_ns - self._operator.stamp_ns > config.command_age_max_ns:
            fault |= Fault.STALE_BODY_COMMAND
        return fault

    def _pass_on(self) -> None:
        """The command within its limits."""
        memory, config, command, output = self.state, self._config, self._command, self._output
        position = np.minimum(np.maximum(command.position, self._low), self._high)
        effort = np.minimum(np.maximum(command.effort, -config.effort_max_nm), config.effort_max_nm)
        step = self._effort_step
        effort = np.minimum(np.maximum(effort, memory.effort - step), memory.effort + step)
        output.position, output.effort, memory.effort = position, effort, effort
        fastest = config.velocity_max_radps
        output.velocity = np.minimum(np.maximum(command.velocity, -fastest), fastest)
        output.stiffness = np.minimum(np.maximum(command.stiffness, 0.0), config.stiffness_max_nm_prad)
        output.damping = np.minimum(np.maximum(command.damping, 0.0), config.damping_max_nms_prad)
        for name in LIMITED:
            given, wanted = getattr(output, name).tolist(), getattr(command, name).tolist()
            if given != wanted:
                memory.limited += sum(map(ne, given, wanted))

    def _damp(self) -> None:
        """No stiffness, no torque, velocity damping."""
        output = self._output
        self.state.effort = 0.0
        output.position, output.velocity, output.effort = self._joints.position, 0.0, 0.0
        output.stiffness, output.damping = 0.0, self._config.damping_nms_prad
