# SPDX-License-Identifier: Apache-2.0
"""Looks for what is wrong with a robot on legs and with its commands; finds bits of `Fault`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.models.inertial import InertialConfig
from runtime.records import float64_array, int64, int64_array, uint32, uint32_array
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
from runtime.safety.config import SafetyConfig
from runtime.safety.limits import is_finite
from runtime.signals import (
    Battery,
    BodyCommand,
    BodyState,
    BusStatus,
    ContactForces,
    Fault,
    Gait,
    Imu,
    JointCommand,
    JointState,
    LoopTiming,
    OperatorRequest,
    Posture,
    Stance,
)

Array = npt.NDArray[np.float64]


class SafetyMemory(WatchMemory):
    """What the filter must remember."""

    coasted = uint32()
    effort = float64_array("joint", "N.m", "of the last command")
    excess = float64_array("joint", "rad", "by which each joint was beyond its limits when power came, and still is")
    reply_ns = int64_array("joint", "ns", "replies of the tick before")
    missing = uint32_array("joint", "", "ticks in a row without a reply")
    unsaturated_ns = int64_array("joint", "ns", "when each joint last gave less than its saturation")
    unbalanced_ns = int64("ns", "when the legs last did not carry the trunk under feedback")
    crouch_ns = int64("ns", "when crouching began")
    derated = uint32("", "faults that the robot is derated for")
    derate_ns = int64("ns", "since when")
    derate_seen_ns = int64("ns", "when such a fault was last there")


class Inputs(NamedTuple):
    """Everything that the filter reads, each as the table of a record."""

    imu: Sequence[Imu]
    joints: Sequence[JointState]
    body: Sequence[BodyState]
    battery: Sequence[Battery]
    buses: Sequence[BusStatus]
    timing: Sequence[LoopTiming]
    operator: Sequence[OperatorRequest]
    body_command: Sequence[BodyCommand]
    gait: Sequence[Gait]
    forces: Sequence[ContactForces]
    command: Sequence[JointCommand]
    posture: Sequence[Posture]


@compiled
def faults(
    config: SafetyConfig,
    inertial: InertialConfig,
    low: Array,
    high: Array,
    memory: SafetyMemory,
    inputs: Inputs,
    now_ns: int,
) -> int:
    """Everything that is wrong, as bits of `Fault`."""
    joints = inputs.joints[0]
    powered = is_powered(memory.mode)
    found = inertial_faults(config, inertial, memory, inputs.imu[0], now_ns)
    found |= reply_faults(config, memory, joints)
    found |= joint_faults(config, memory, joints, now_ns)
    found |= bus_faults(memory, inputs.buses[0])
    found |= estimate_faults(config, inputs.body[0])
    found |= battery_faults(config, inputs.battery[0])
    found |= loop_faults(config, memory, inputs.timing[0], now_ns)
    found |= plan_faults(config, memory, inputs.gait[0], inputs.forces[0], inputs.body_command[0], now_ns)
    found |= position_faults(config, memory, low, high, joints, inputs.posture[0].stance, powered)
    if powered:
        found |= operator_faults(config, inputs.operator[0], now_ns)
        found |= standstill_faults(config, inputs.timing[0])
    if inputs.operator[0].emergency_stop:
        found |= Fault.EMERGENCY_STOP.value
    if not is_finite(inputs.command[0]):
        found |= Fault.NON_FINITE_COMMAND.value
    return found


@compiled
def reply_faults(config: SafetyConfig, memory: SafetyMemory, joints: JointState) -> int:
    """Count the replies that are missing: every tick asks each drive for one."""
    found = 0
    for joint in range(joints.reply_ns.shape[0]):
        if joints.reply_ns[joint] == 0:
            found |= Fault.STALE_MOTOR.value
        elif joints.reply_ns[joint] != memory.reply_ns[joint]:
            memory.reply_ns[joint], memory.missing[joint] = joints.reply_ns[joint], 0
        elif memory.missing[joint] < config.missing_replies_max:
            memory.missing[joint] += 1
            memory.coasted += 1
            found |= Fault.MISSING_REPLY.value
        else:
            found |= Fault.STALE_MOTOR.value
    return found


@compiled
def joint_faults(config: SafetyConfig, memory: SafetyMemory, joints: JointState, now_ns: int) -> int:
    """What the drives say of themselves."""
    found = 0
    if joints.error.any():
        found |= Fault.MOTOR_FAULT.value
    if (joints.temperature > config.temperature_max_degc).any():
        found |= Fault.TEMPERATURE.value
    if not (np.abs(joints.velocity) <= config.velocity_max_radps).all():
        found |= Fault.JOINT_VELOCITY.value
    for joint in range(joints.effort.shape[0]):
        if abs(joints.effort[joint]) < config.saturation_nm:
            memory.unsaturated_ns[joint] = now_ns
        elif now_ns - memory.unsaturated_ns[joint] > config.saturation_ns:
            found |= Fault.SATURATION.value
    return found


@compiled
def plan_faults(
    config: SafetyConfig, memory: SafetyMemory, gait: Gait, forces: ContactForces, command: BodyCommand, now_ns: int
) -> int:
    """Old plans of the other loop, counted from when they are needed."""
    if not gait.balancing:
        memory.unbalanced_ns = now_ns
    found, age_ns = 0, now_ns - max(forces.stamp_ns, memory.unbalanced_ns)
    if age_ns > config.forces_late_ns:
        found |= Fault.LATE_FORCES.value
    if age_ns > config.forces_age_max_ns:
        found |= Fault.STALE_FORCES.value
    if age_ns > config.forces_age_max_ns + config.forces_stand_max_ns:
        found |= Fault.NO_FORCES.value
    if now_ns - max(command.stamp_ns, memory.unbalanced_ns) > config.command_age_max_ns:
        found |= Fault.STALE_BODY_COMMAND.value
    return found


@compiled
def position_faults(
    config: SafetyConfig,
    memory: SafetyMemory,
    low: Array,
    high: Array,
    joints: JointState,
    stance: int,
    powered: bool,
) -> int:
    """A joint under power that is far beyond its limits, or at a position that is no number.

    One that has sunk beyond them without power may come back, but not go further. While the robot gets up its weight
    shifts from leg to leg: until then a joint may be where it lay.
    """
    found, gets_up = 0, stance == Stance.GATHERING or stance == Stance.RISING
    for joint in range(low.shape[0]):
        beyond = max(joints.position[joint] - high[joint], low[joint] - joints.position[joint])
        if not powered:
            memory.excess[joint] = max(beyond, 0.0)
        elif not beyond <= memory.excess[joint] + config.position_margin_rad:
            found = Fault.JOINT_POSITION.value
        elif not gets_up:
            memory.excess[joint] = min(memory.excess[joint], max(beyond, 0.0))
    return found
