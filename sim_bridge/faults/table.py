# SPDX-License-Identifier: Apache-2.0
"""Every fault that a walk in lockstep can have, with its answer and how soon that is due."""

from __future__ import annotations

from collections.abc import Callable

from runtime.robots import topics
from runtime.robots.uslgo1.config import NS_PER_SECOND, Uslgo1Config
from runtime.signals import Fault, Request
from sim_bridge.courses import scenario
from sim_bridge.faults import buses, joint_drives, operator, robot, sensors
from sim_bridge.faults.foreign_rows import foreign_rows
from sim_bridge.faults.joint_drives import bad_torque
from sim_bridge.faults.loops import late, spoiled
from sim_bridge.faults.operator import (
    OTHER,
    TAKES_OVER,
    asks_for,
    interrupted,
    operator_says,
    says,
)
from sim_bridge.faults.sensors import silent
from sim_bridge.faults.table_parts import (
    COASTED,
    IMU_REJECTED,
    LEASES,
    MS,
    POSE_REJECTED,
    SKIPPED,
    SPIKING,
    at_once,
    imu_stale,
    lease_over,
    pose_disputed,
    pose_missing,
    velocity_old,
)
from sim_bridge.faults.walk import WalkRow
from sim_bridge.sensors import BatterySensor

WALK_ON, DAMP, CROUCH = ("walk on",), ("damp",), ("crouch", "damp")
PAUSE, STAND, DERATE = ("stand", "go on"), ("stand",), ("derate", "stand", "damp")
Bound = Callable[[Uslgo1Config], int]


def ticks(count: int) -> Bound:
    """So many ticks of the fast loop."""
    return lambda config: count * config.loops.wbc_period_ns


def unanswered(config: Uslgo1Config) -> int:
    """Until a tick more than is bridged has passed without a reply, the first of which was on its way."""
    return (config.safety.missing_replies_max + 3) * config.loops.wbc_period_ns


def crouched(after: Bound) -> Bound:
    """Until a fault of the IMU is known, and the robot is down."""
    return lambda config: after(config) + int(config.posture.crouch_s * 1e9) + 4 * config.loops.wbc_period_ns


def imu_frozen(config: Uslgo1Config) -> int:
    """Until too many samples are alike."""
    return config.safety.imu_frozen_samples * NS_PER_SECOND // config.simulation.imu_rate_hz


def stood(after: Bound) -> Bound:
    """Until a fault is known, and the robot has slowed to a stand, which it does at the end of a step."""

    def bound(config: Uslgo1Config) -> int:
        braking_s = scenario("flat").speed_mps / config.tracker.speed.deceleration_mps2
        tracker_ns = 2 * NS_PER_SECOND // config.loops.tracker_hz
        return after(config) + int(braking_s * 1e9) + config.gait.period_ns + tracker_ns + config.loops.mpc_budget_ns

    return bound


def derated(after: Bound) -> Bound:
    """Until a fault is known, and has been borne for as long as may be."""
    return lambda config: after(config) + config.safety.derate_ns + 4 * config.loops.wbc_period_ns


def plan_missing(config: Uslgo1Config) -> int:
    """Until the last plan, made ahead by the budget, is too old, and the feet have come down."""
    after_ns = config.safety.forces_age_max_ns + config.loops.mpc_budget_ns + 3 * config.loops.wbc_period_ns
    return after_ns + config.gait.period_ns // 2


def plan_given_up(config: Uslgo1Config) -> int:
    """Until standing without a plan has lasted too long."""
    bounds_ns = config.safety.forces_age_max_ns + config.safety.forces_stand_max_ns
    return bounds_ns + config.loops.mpc_budget_ns + 3 * config.loops.wbc_period_ns


def overrun(config: Uslgo1Config) -> int:
    """Until so many ticks have overrun by one period each."""
    return (2 * config.safety.overruns_damp + 2) * config.loops.wbc_period_ns


def saturated(config: Uslgo1Config) -> int:
    """Until a drive has given its most for too long."""
    return config.safety.saturation_ns + 3 * config.loops.wbc_period_ns


def battery_read(config: Uslgo1Config) -> int:
    """Until the battery is looked at again."""
    return BatterySensor.PERIOD_NS + 2 * config.loops.wbc_period_ns


REJECTED = (topics.JOINT_STATE, "rejected")

ROWS = (
    WalkRow("a reply missing", joint_drives.no_replies, WALK_ON, at_once, 6 * MS, Fault.MISSING_REPLY, COASTED),
    WalkRow("replies missing", joint_drives.no_replies, DAMP, unanswered, fault=Fault.STALE_MOTOR),
    WalkRow("bus down", buses.bus_down, DAMP, ticks(2), fault=Fault.BUS),
    WalkRow("bus-off", buses.bus_off, DAMP, ticks(3), fault=Fault.BUS),
    WalkRow("bus flooded", buses.flooded(32), DAMP, ticks(3), fault=Fault.BUS),
    WalkRow("bus full", buses.bus_full, DAMP, ticks(3), fault=Fault.BUS),
    WalkRow("motor fault", joint_drives.drive_error, DAMP, ticks(3), fault=Fault.MOTOR_FAULT),
    WalkRow(
        "motor fault, derated",
        joint_drives.reported_error,
        DERATE,
        derated(ticks(3)),
        fault=Fault.MOTOR_FAULT,
        settings={"safety.motor_fault": "derate"},
    ),
    WalkRow("over-temperature", joint_drives.hot_drive, DERATE, derated(ticks(3)), fault=Fault.TEMPERATURE),
    WalkRow(
        "over-temperature, damped",
        joint_drives.hot_drive,
        DAMP,
        ticks(3),
        fault=Fault.TEMPERATURE,
        settings={"safety.temperature": "damp"},
    ),
    WalkRow("under-voltage", sensors.low_battery, DAMP, battery_read, fault=Fault.VOLTAGE),
    WalkRow(
        "under-voltage, derated",
        sensors.low_battery,
        DERATE,
        derated(battery_read),
        fault=Fault.VOLTAGE,
        settings={"safety.voltage": "derate"},
    ),
    WalkRow("torque saturated", joint_drives.saturated_drive, DERATE, derated(saturated), fault=Fault.SATURATION),
    WalkRow(
        "torque saturated, damped",
        joint_drives.saturated_drive,
        DAMP,
        saturated,
        fault=Fault.SATURATION,
        settings={"safety.saturation": "damp"},
    ),
    WalkRow("leg out of range", joint_drives.joint_out_of_range, DAMP, ticks(3), fault=Fault.JOINT_POSITION),
    WalkRow("malformed frames", buses.malformed_frames, WALK_ON, at_once, 500 * MS, counted=REJECTED),
    WalkRow("IMU silent", silent(topics.IMU), CROUCH, crouched(imu_stale), fault=Fault.STALE_IMU),
    WalkRow("IMU frozen", sensors.frozen_imu, CROUCH, crouched(imu_frozen), fault=Fault.FROZEN_IMU),
    WalkRow("IMU NaN", sensors.nan_imu, CROUCH, crouched(imu_stale), fault=Fault.STALE_IMU | Fault.NON_FINITE_SENSOR),
    WalkRow("IMU NaN once", sensors.nan_imu, WALK_ON, at_once, 2 * MS, Fault.NON_FINITE_SENSOR, IMU_REJECTED),
    WalkRow("IMU spiking", sensors.spiking_imu, CROUCH, crouched(imu_stale), fault=SPIKING),
    WalkRow("IMU spiking once", sensors.spiking_imu, WALK_ON, at_once, 2 * MS, Fault.IMPLAUSIBLE_IMU, IMU_REJECTED),
    WalkRow(
        "IMU time backwards", sensors.backward_imu, CROUCH, crouched(imu_stale), fault=Fault.STALE_IMU | Fault.IMU_TIME
    ),
    WalkRow(
        "localisation silent",
        silent(topics.LOCALIZATION),
        PAUSE,
        stood(pose_missing),
        3500 * MS,
        Fault.STALE_LOCALIZATION,
    ),
    WalkRow("localisation jumps", sensors.jumping_pose, WALK_ON, at_once, 500 * MS, counted=POSE_REJECTED),
    WalkRow("localisation moved", sensors.jumping_pose, STAND, stood(pose_disputed), fault=Fault.MOVED_LOCALIZATION),
    WalkRow("MPC late 3 periods", late("mpc", 60 * MS), WALK_ON, at_once, 20 * MS, Fault.LATE_FORCES),
    WalkRow("MPC late 400 ms", late("mpc", 400 * MS), PAUSE, plan_missing, 20 * MS, Fault.STALE_FORCES),
    WalkRow(
        "MPC hung", late("mpc", 10**12), ("stand", "damp"), plan_given_up, fault=Fault.STALE_FORCES | Fault.NO_FORCES
    ),
    WalkRow("WBC overrun", late("wbc", 5 * MS), WALK_ON, at_once, 2 * MS, counted=SKIPPED),
    WalkRow("WBC overruns, 3 in a row", late("wbc", 3 * MS), PAUSE, stood(ticks(6)), 12 * MS, Fault.LATE_LOOP, SKIPPED),
    WalkRow("WBC overruns, 5 in a row", late("wbc", 3 * MS), DAMP, overrun, fault=Fault.OVERRUNS, counted=SKIPPED),
    WalkRow("WBC stalls for 15 ms", late("wbc", 15 * MS), WALK_ON, at_once, 2 * MS, counted=SKIPPED),
    WalkRow("rolled over", robot.rolled_over(50.0), DAMP, lambda config: 2 * NS_PER_SECOND, fault=Fault.TILT),
    WalkRow("thrown over", robot.pushed_over, DAMP, lambda config: 2 * NS_PER_SECOND, forced=True),
    WalkRow(
        "command not finite",
        spoiled("locomotion", topics.JOINT_COMMAND, bad_torque),
        DAMP,
        ticks(1),
        fault=Fault.NON_FINITE_COMMAND,
    ),
    WalkRow(
        "operator silent",
        silent(topics.OPERATOR_EVENT),
        PAUSE,
        stood(lease_over),
        3000 * MS,
        Fault.NO_LEASE,
        mended=operator.walks_again,
    ),
    WalkRow("velocity silent", interrupted(asks_for(0.4, 0.1, 0.3)), STAND, stood(velocity_old)),
    WalkRow(
        "lease released",
        operator_says(says(Request.RELEASE)),
        PAUSE,
        stood(ticks(2)),
        2500 * MS,
        Fault.NO_LEASE,
        mended=operator.walks_again,
    ),
    WalkRow(
        "lease taken over",
        interrupted(TAKES_OVER),
        PAUSE,
        stood(ticks(2)),
        2500 * MS,
        counted=LEASES,
        mended=operator.walks_again,
    ),
    WalkRow(
        "emergency stop",
        interrupted(says(Request.EMERGENCY_STOP, source=OTHER, priority=0)),
        DAMP,
        ticks(2),
        fault=Fault.EMERGENCY_STOP,
    ),
    *foreign_rows(WalkRow, WALK_ON),
)
