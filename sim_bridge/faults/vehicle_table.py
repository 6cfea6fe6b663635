# SPDX-License-Identifier: Apache-2.0
"""Every fault that a vehicle's drive in lockstep can have, with its answer and how soon that is due."""

from __future__ import annotations

import numpy as np

from drivers.memory_bus import End
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import Fault, Request
from runtime.vehicle_signals import TwistCommand, WheelCommand
from sim_bridge.faults import buses, control_unit, operator, sensors
from sim_bridge.faults.drive import DriveRow
from sim_bridge.faults.drive_bounds import (
    commands_refused,
    halted,
    imu_frozen,
    imu_missing,
    overrun,
    refused,
    rested,
    state_missing,
    stood,
    stuck,
    temperature_read,
    ticks,
    twist_old,
    unheard,
)
from sim_bridge.faults.foreign_rows import foreign_rows
from sim_bridge.faults.loops import idle, late, spoiled
from sim_bridge.faults.operator import OTHER, TAKES_OVER, asks_for, interrupted, operator_says, says
from sim_bridge.faults.robot import rolled_over
from sim_bridge.faults.sensors import silent
from sim_bridge.faults.table_parts import (
    BACKWARDS,
    COASTED,
    IMU_REJECTED,
    LEASES,
    MS,
    POSE_REJECTED,
    SKIPPED,
    SPIKING,
    at_once,
    lease_over,
    pose_disputed,
    pose_missing,
    velocity_old,
)
from sim_bridge.faults.wires import AnyWires

DRIVE_ON, STOP = ("drive on",), ("brake", "rest")
PAUSE, STAND = ("stand", "go on"), ("stand",)
TICK_NS = 10 * MS
"""For as long as a fault that is there for one tick."""
ROLL_NM = 800.0
"""Turns the vehicle over: its weight holds it down with 430 N.m."""


def bad_wheel(wires: AnyWires, command: Record) -> None:
    """The steering computes an angle or a speed that is no number."""
    assert isinstance(command, WheelCommand)
    values = (command.steering, command.speed)[wires.rng.integers(2)]
    values[wires.rng.integers(len(values))] = wires.rng.choice((np.nan, np.inf, -np.inf))


def bad_twist(wires: AnyWires, command: Record) -> None:
    """The tracker computes a motion that is none."""
    assert isinstance(command, TwistCommand)
    command.velocity[0], command.yaw_rate = ((np.nan, 0.0), (0.5, np.nan), (np.inf, 0.0))[wires.rng.integers(3)]


REJECTED, CORRUPT, STALLED = ((topics.WHEEL_STATE, name) for name in ("rejected", "corrupt", "stalled"))
WITHHELD = (topics.BUS_STATUS, "withheld")
ON_A_BUS = unheard(ticks(3))

VEHICLE_ROWS = (
    DriveRow(
        "state frames of a wheel missing, 2",
        control_unit.silent_wheel,
        DRIVE_ON,
        at_once,
        2 * TICK_NS,
        Fault.MISSING_REPLY,
        COASTED,
    ),
    DriveRow("wheel silent", control_unit.silent_wheel, STOP, rested(state_missing), fault=Fault.STALE_MOTOR),
    DriveRow("control unit silent", control_unit.silent_unit, STOP, rested(state_missing), fault=Fault.STALE_MOTOR),
    DriveRow(
        "states damaged",
        control_unit.damaged(End.DEVICE),
        STOP,
        rested(state_missing),
        fault=Fault.STALE_MOTOR,
        counted=CORRUPT,
    ),
    DriveRow(
        "states repeated",
        control_unit.repeated_states,
        STOP,
        rested(state_missing),
        fault=Fault.STALE_MOTOR,
        counted=STALLED,
    ),
    DriveRow(
        "commands damaged",
        control_unit.damaged(End.HOST),
        STOP,
        rested(commands_refused),
        fault=Fault.MOTOR_FAULT,
    ),
    DriveRow("control unit refuses", control_unit.refusing, STOP, rested(refused), fault=Fault.MOTOR_FAULT),
    DriveRow("bus down", buses.bus_down, STOP, ON_A_BUS, fault=Fault.BUS),
    DriveRow("bus-off", buses.bus_off, STOP, ON_A_BUS, fault=Fault.BUS),
    DriveRow("bus flooded", control_unit.flooded_bus, STOP, unheard(state_missing), fault=Fault.STALE_MOTOR),
    DriveRow("bus full", buses.bus_full, STOP, ON_A_BUS, fault=Fault.BUS),
    DriveRow("malformed frames", buses.malformed_frames, DRIVE_ON, at_once, 500 * MS, counted=REJECTED),
    DriveRow("motor fault", control_unit.driving_fault, STOP, rested(ticks(3)), fault=Fault.MOTOR_FAULT),
    DriveRow(
        "steering motor fault",
        control_unit.steering_fault,
        STOP,
        rested(ticks(3)),
        fault=Fault.MOTOR_FAULT | Fault.STUCK_STEERING,
    ),
    DriveRow("steering stuck", control_unit.jammed_steering, STOP, rested(stuck), fault=Fault.STUCK_STEERING),
    DriveRow("wheel too fast", control_unit.fast_wheel, STOP, rested(ticks(3)), fault=Fault.JOINT_VELOCITY),
    DriveRow("over-temperature", control_unit.hot_motor, PAUSE, stood(temperature_read), 2000 * MS, Fault.TEMPERATURE),
    DriveRow("under-voltage", control_unit.low_battery, STOP, rested(ticks(3)), fault=Fault.VOLTAGE),
    DriveRow("IMU silent", silent(topics.IMU), STOP, rested(imu_missing), fault=Fault.STALE_IMU),
    DriveRow("IMU frozen", sensors.frozen_imu, STOP, rested(imu_frozen), fault=Fault.FROZEN_IMU),
    DriveRow("IMU NaN", sensors.nan_imu, STOP, rested(imu_missing), fault=Fault.STALE_IMU | Fault.NON_FINITE_SENSOR),
    DriveRow("IMU NaN once", sensors.nan_imu, DRIVE_ON, at_once, TICK_NS, Fault.NON_FINITE_SENSOR, IMU_REJECTED),
    DriveRow("IMU spiking", sensors.spiking_imu, STOP, rested(imu_missing), fault=SPIKING),
    DriveRow("IMU spiking once", sensors.spiking_imu, DRIVE_ON, at_once, TICK_NS, Fault.IMPLAUSIBLE_IMU, IMU_REJECTED),
    DriveRow("IMU time backwards", sensors.backward_imu, STOP, rested(imu_missing), fault=BACKWARDS),
    DriveRow(
        "localisation silent",
        silent(topics.LOCALIZATION),
        PAUSE,
        stood(pose_missing),
        2500 * MS,
        Fault.STALE_LOCALIZATION,
    ),
    DriveRow("localisation jumps", sensors.jumping_pose, DRIVE_ON, at_once, 500 * MS, counted=POSE_REJECTED),
    DriveRow("localisation moved", sensors.jumping_pose, STAND, stood(pose_disputed), fault=Fault.MOVED_LOCALIZATION),
    DriveRow("tracker late 150 ms", idle("tracker"), DRIVE_ON, at_once, 150 * MS),
    DriveRow("tracker late 1.5 s", idle("tracker"), PAUSE, stood(twist_old), 1500 * MS, Fault.STALE_BODY_COMMAND),
    DriveRow("drive loop overrun", late("drive", 15 * MS), DRIVE_ON, at_once, TICK_NS, counted=SKIPPED),
    DriveRow(
        "drive loop overruns, 3 in a row",
        late("drive", 15 * MS),
        PAUSE,
        stood(overrun(3)),
        6 * TICK_NS,
        Fault.LATE_LOOP,
        SKIPPED,
    ),
    DriveRow(
        "drive loop overruns, 5 in a row",
        late("drive", 15 * MS),
        STOP,
        rested(overrun(5)),
        10 * TICK_NS,
        Fault.OVERRUNS,
        SKIPPED,
    ),
    DriveRow("drive loop stalls for 60 ms", late("drive", 60 * MS), DRIVE_ON, at_once, TICK_NS, counted=WITHHELD),
    DriveRow(
        "drive loop stalls for 300 ms",
        late("drive", 300 * MS),
        STOP,
        rested(ticks(32)),
        TICK_NS,
        Fault.STOOD_STILL,
        SKIPPED,
    ),
    DriveRow("rolled over", rolled_over(ROLL_NM), STOP, rested(ticks(100)), fault=Fault.TILT),
    DriveRow(
        "command not finite",
        spoiled("steering", topics.WHEEL_COMMAND, bad_wheel),
        STOP,
        rested(ticks(1)),
        fault=Fault.NON_FINITE_COMMAND,
    ),
    DriveRow(
        "motion not finite",
        spoiled("tracker", topics.BODY_COMMAND, bad_twist),
        STOP,
        rested(ticks(2)),
        fault=Fault.NON_FINITE_COMMAND,
    ),
    DriveRow(
        "operator silent",
        silent(topics.OPERATOR_EVENT),
        PAUSE,
        stood(lease_over),
        2000 * MS,
        Fault.NO_LEASE,
        mended=operator.walks_again,
    ),
    DriveRow("velocity silent", interrupted(asks_for(0.4, 0.0, 0.1)), STAND, stood(velocity_old)),
    DriveRow(
        "lease released",
        operator_says(says(Request.RELEASE)),
        PAUSE,
        stood(ticks(2)),
        1500 * MS,
        Fault.NO_LEASE,
        mended=operator.walks_again,
    ),
    DriveRow(
        "lease taken over",
        interrupted(TAKES_OVER),
        PAUSE,
        halted,
        1500 * MS,
        counted=LEASES,
        mended=operator.walks_again,
    ),
    DriveRow(
        "emergency stop",
        interrupted(says(Request.EMERGENCY_STOP, source=OTHER, priority=0)),
        STOP,
        rested(ticks(2)),
        fault=Fault.EMERGENCY_STOP,
    ),
    *foreign_rows(DriveRow, DRIVE_ON),
)
