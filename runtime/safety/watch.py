# SPDX-License-Identifier: Apache-2.0
"""Looks for what is wrong with the inputs, the loop and the commands; finds bits of `Fault`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.models.inertial import InertialConfig, is_finite_sample, is_plausible
from runtime.records import Record, float64_array, int64, int64_array, uint8, uint32, uint32_array
from runtime.safety.answers import is_powered
from runtime.safety.config import SafetyConfig
from runtime.safety.limits import is_finite, tilt
from runtime.signals import (
    Battery,
    BodyCommand,
    BodyState,
    BusState,
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
)

Array = npt.NDArray[np.float64]


class SafetyMemory(Record):
    """What the filter must remember."""

    mode = uint8()
    fault = uint32()
    limited = uint32()
    faults = uint32()
    coasted = uint32()
    effort = float64_array("joint", "N.m", "of the last command")
    imu_ns = int64("ns", "stamp of the last good inertial sample")
    imu_seen_ns = int64("ns", "stamp of the last one")
    imu_fault = uint32("", "what was wrong with that")
    imu_alike = uint32("", "samples in a row that are alike")
    good = float64_array(6, "m/s^2, rad/s", "last good sample: specific force, angular velocity")
    last = float64_array(6, "m/s^2, rad/s", "last sample")
    excess = float64_array("joint", "rad", "by which each joint was beyond its limits when power came, and still is")
    reply_ns = int64_array("joint", "ns", "replies of the tick before")
    missing = uint32_array("joint", "", "ticks in a row without a reply")
    unsaturated_ns = int64_array("joint", "ns", "when each joint last gave less than its saturation")
    refused = uint32_array("bus", "", "frames refused up to the tick before")
    unbalanced_ns = int64("ns", "when the legs last did not carry the trunk under feedback")
    overrun_ns = int64("ns", "when there last were so many overruns in a row that the robot is to stand; 0 for never")
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
    found |= body_faults(config, inputs.body[0], inputs.battery[0].voltage)
    found |= loop_faults(config, memory, inputs.timing[0], now_ns)
    found |= plan_faults(config, memory, inputs.gait[0], inputs.forces[0], inputs.body_command[0], now_ns)
    found |= position_faults(config, memory, low, high, joints, powered)
    if powered:
        found |= operator_faults(config, inputs.operator[0], now_ns)
    if inputs.operator[0].emergency_stop:
        found |= Fault.EMERGENCY_STOP.value
    if not is_finite(inputs.command[0]):
        found |= Fault.NON_FINITE_COMMAND.value
    return found


@compiled
def inertial_faults(config: SafetyConfig, inertial: InertialConfig, memory: SafetyMemory, imu: Imu, now_ns: int) -> int:
    """Judge a new inertial sample; what is wrong with the newest, and with the sensor for want of good ones."""
    if imu.stamp_ns != memory.imu_seen_ns:
        memory.imu_seen_ns = imu.stamp_ns
        memory.imu_fault = _flaw(inertial, memory, imu, now_ns + config.imu_age_max_ns)
        if memory.imu_fault == 0:
            alike = (imu.linear_acceleration == memory.good[:3]).all()
            alike = alike and (imu.angular_velocity == memory.good[3:]).all()
            memory.imu_alike = memory.imu_alike + 1 if alike else 1
            memory.imu_ns = imu.stamp_ns
            memory.good[:3], memory.good[3:] = imu.linear_acceleration, imu.angular_velocity
        memory.last[:3], memory.last[3:] = imu.linear_acceleration, imu.angular_velocity
    found = int(memory.imu_fault)
    if now_ns - memory.imu_ns > config.imu_age_max_ns:
        found |= Fault.STALE_IMU.value
    if memory.imu_alike >= config.imu_frozen_samples:
        found |= Fault.FROZEN_IMU.value
    return found


@compiled
def _flaw(inertial: InertialConfig, memory: SafetyMemory, imu: Imu, latest_ns: int) -> int:
    if not is_finite_sample(imu):
        return Fault.NON_FINITE_SENSOR.value
    if imu.stamp_ns < memory.imu_ns or imu.stamp_ns > latest_ns:
        return Fault.IMU_TIME.value
    if not is_plausible(inertial, imu, memory.good, memory.last):
        return Fault.IMPLAUSIBLE_IMU.value
    return 0


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
def bus_faults(memory: SafetyMemory, buses: BusStatus) -> int:
    """A bus that is gone, flooded or full."""
    found = 0
    for bus in range(buses.state.shape[0]):
        gone = buses.state[bus] == BusState.OFF or buses.state[bus] == BusState.DOWN
        full = buses.refused[bus] != memory.refused[bus]
        if gone or full or buses.backlog[bus]:
            found |= Fault.BUS.value
        memory.refused[bus] = buses.refused[bus]
    return found


@compiled
def body_faults(config: SafetyConfig, body: BodyState, voltage: float) -> int:
    """What the estimate and the battery (V, 0 if it is not known) say."""
    found = 0
    if voltage > 0.0 and not config.voltage_min_v <= voltage <= config.voltage_max_v:
        found |= Fault.VOLTAGE.value
    if body.localization_age_ns > config.localization_age_max_ns:
        found |= Fault.STALE_LOCALIZATION.value
    if body.localization_disputed >= config.disputed_poses_max:
        found |= Fault.MOVED_LOCALIZATION.value
    if not tilt(body.orientation) <= config.tilt_max_rad:
        found |= Fault.TILT.value
    return found


@compiled
def loop_faults(config: SafetyConfig, memory: SafetyMemory, timing: LoopTiming, now_ns: int) -> int:
    """Overruns in a row of the loop that this is in."""
    found = 0
    if timing.overruns_in_a_row >= config.overruns_stand:
        memory.overrun_ns = now_ns
    if memory.overrun_ns > 0 and now_ns - memory.overrun_ns <= config.overruns_stand_ns:
        found |= Fault.LATE_LOOP.value
    if timing.overruns_in_a_row >= config.overruns_damp:
        found |= Fault.OVERRUNS.value
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
    config: SafetyConfig, memory: SafetyMemory, low: Array, high: Array, joints: JointState, powered: bool
) -> int:
    """A joint under power that is far beyond its limits, or at a position that is no number.

    One that has sunk beyond them without power may come back, but not go further.
    """
    found = 0
    for joint in range(low.shape[0]):
        beyond = max(joints.position[joint] - high[joint], low[joint] - joints.position[joint])
        if not powered:
            memory.excess[joint] = max(beyond, 0.0)
        elif not beyond <= memory.excess[joint] + config.position_margin_rad:
            found = Fault.JOINT_POSITION.value
        else:
            memory.excess[joint] = min(memory.excess[joint], max(beyond, 0.0))
    return found


@compiled
def operator_faults(config: SafetyConfig, operator: OperatorRequest, now_ns: int) -> int:
    """An operator that is silent, and nobody who holds the lease."""
    found = 0
    if now_ns - operator.stamp_ns > config.operator_age_max_ns:
        found |= Fault.STALE_OPERATOR.value
    if not operator.held:
        found |= Fault.NO_LEASE.value
    return found
