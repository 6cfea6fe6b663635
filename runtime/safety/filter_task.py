# SPDX-License-Identifier: Apache-2.0
"""The last task before the drives: limits every command, and answers when something is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.models.inertial import InertialConfig
from runtime.safety.answers import HALTS, POWERED, derating_faults, health_of
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
    Motion,
    OperatorRequest,
    Posture,
    SafetyStatus,
    Stance,
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
        self._config, self._derating = config, derating_faults(config)
        self._operator, self._posture, self._gait, self._status = operator, posture, gait, status
        watched = (imu, joints, body, battery, buses, timing, operator, body_command, gait, forces, command)
        self.reads, self.writes = (*watched, posture), (output, status)
        self.state: SafetyMemory = SafetyMemory("/ugv/state/safety", output.sizes)
        parameters, low, high = table_of(config), *joint_bounds(config)
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
        )
        self._faults = partial(faults, parameters, table_of(inertial), low, high, self.state.table, inputs)
        effort_step = config.effort_rate_max_nmps * period_ns * 1e-9
        self._filter = partial(
            _filter, parameters, low, high, effort_step, joints.table, command.table, self.state.table, output.table
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, status = self.state, self._status
        found = self._faults(now_ns)
        before = Mode(memory.mode)
        tolerated = self._derate(before, found, now_ns)
        mode = self._next_mode(before, self._health(before, found, tolerated, now_ns))
        if mode in (Mode.CROUCHING, Mode.DAMPED) and before not in (Mode.CROUCHING, Mode.DAMPED):
            memory.fault, memory.faults, memory.crouch_ns = found, memory.faults + 1, now_ns
        elif mode == Mode.DAMPED and before == Mode.CROUCHING:
            memory.fault |= found
        elif mode not in (Mode.CROUCHING, Mode.DAMPED):
            memory.fault = 0
        memory.mode = mode
        self._filter(now_ns, mode in POWERED and before in POWERED, memory.derated != 0)
        status.stamp_ns, status.mode, status.warning = now_ns, mode, found
        status.fault, status.limited, status.faults = memory.fault, memory.limited, memory.faults
        status.halt, status.coasted = found & HALTS | memory.derated, memory.coasted
        status.derated = memory.derated != 0

    def _next_mode(self, mode: Mode, health: Health) -> Mode:
        operator = self._operator
        return next_mode(
            mode,
            health,
            operator.arm,
            operator.reset,
            Motion(operator.motion),
            Stance(self._posture.stance),
            self._gait.walking,
        )

    def _health(self, mode: Mode, found: int, tolerated: int, now_ns: int) -> Health:
        if mode == Mode.CROUCHING and now_ns - self.state.crouch_ns > self._config.crouch_max_ns:
            return Health.UNFIT
        return health_of(found, mode, tolerated)

    def _derate(self, mode: Mode, found: int, now_ns: int) -> int:
        """Keep account of the faults that the robot is derated for; those that are tolerated yet."""
        memory, present = self.state, found & self._derating
        if mode not in POWERED:
            memory.derated = 0
            return 0
        if present:
            if not memory.derated:
                memory.derate_ns = now_ns
            memory.derated |= present
            memory.derate_seen_ns = now_ns
        elif now_ns - memory.derate_seen_ns > self._config.derate_clear_ns:
            memory.derated = 0
        expired = memory.derated and now_ns - memory.derate_ns > self._config.derate_ns
        return 0 if expired else self._derating


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
    derated: bool,
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
    if derated:
        strongest = config.derated_effort_nm * one
    lowest = np.maximum(-strongest, np.minimum(strongest, memory.effort - effort_step))
    highest = np.maximum(-strongest, np.minimum(strongest, memory.effort + effort_step))
    altered = within(command.position, low, high, output.position)
    altered += within(command.velocity, -fastest, fastest, output.velocity)
    altered += within(command.effort, lowest, highest, output.effort)
    altered += within(command.stiffness, 0.0 * one, config.stiffness_max_nm_prad * one, output.stiffness)
    altered += within(command.damping, 0.0 * one, config.damping_max_nms_prad * one, output.damping)
    memory.limited += altered
    memory.effort[:] = output.effort
