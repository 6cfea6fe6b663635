# SPDX-License-Identifier: Apache-2.0
"""Every fault that lockstep can have, with its answer and how soon that is due."""

from __future__ import annotations

from collections.abc import Callable

from runtime.robots import topics
from runtime.robots.uslgo1.config import NS_PER_SECOND, Uslgo1Config
from runtime.signals import Fault, Motion, Request
from sim_bridge.courses import scenario
from sim_bridge.faults import buses, operator, robot, sensors
from sim_bridge.faults.operator import asks_for, interrupted, operator_says, path_withdrawn_by, says
from sim_bridge.faults.robot import late
from sim_bridge.faults.sensors import silent
from sim_bridge.faults.trial import Row
from sim_bridge.script import PERIOD_NS
from sim_bridge.sensors import BatterySensor

MS = 1_000_000
OTHER, BOSS = 2, 3
"""Senders of lower and of higher priority than the operator's."""
WALK_ON, DAMP, CROUCH = ("walk on",), ("damp",), ("crouch", "damp")
PAUSE, STAND, DERATE = ("stand", "go on"), ("stand",), ("derate", "stand", "damp")
Bound = Callable[[Uslgo1Config], int]


def ticks(count: int) -> Bound:
    """So many ticks of the fast loop."""
    return lambda config: count * config.loops.wbc_period_ns


def at_once(config: Uslgo1Config) -> int:
    """It needs no time."""
    return 0


def unanswered(config: Uslgo1Config) -> int:
    """Until a tick more than is bridged has passed without a reply, the first of which was on its way."""
    return (config.safety.missing_replies_max + 3) * config.loops.wbc_period_ns


def crouched(after: Bound) -> Bound:
    """Until a fault of the IMU is known, and the robot is down."""
    return lambda config: after(config) + int(config.posture.crouch_s * 1e9) + 4 * config.loops.wbc_period_ns


def imu_stale(config: Uslgo1Config) -> int:
    """Until the last sample is too old."""
    return config.safety.imu_age_max_ns


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


def pose_missing(config: Uslgo1Config) -> int:
    """Until the last pose is too old."""
    return config.safety.localization_age_max_ns


def pose_disputed(config: Uslgo1Config) -> int:
    """Until enough poses agree that it is elsewhere."""
    period_ns = NS_PER_SECOND // config.simulation.localization_rate_hz
    return (config.safety.disputed_poses_max + 1) * period_ns + config.simulation.localization_latency_ns


def lease_over(config: Uslgo1Config) -> int:
    """Until the lease of a silent operator is over."""
    return config.authority.lease_ns + PERIOD_NS


def velocity_old(config: Uslgo1Config) -> int:
    """Until the velocity that was asked for is too old."""
    return config.tracker.velocity.age_max_ns


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


COASTED, REJECTED = (topics.SAFETY, "coasted"), (topics.JOINT_STATE, "rejected")
IMU_REJECTED = (topics.BODY_STATE, "imu_rejected")
POSE_REJECTED = (topics.BODY_STATE, "localization_rejected")
REFUSED, MALFORMED = (topics.OPERATOR, "refused"), (topics.OPERATOR, "malformed")
PATH_REJECTED, PATH_FOREIGN = (topics.BODY_COMMAND, "rejected_paths"), (topics.BODY_COMMAND, "foreign_paths")
SKIPPED = (topics.TIMING, "skipped")
SPIKING, BACKWARDS = Fault.STALE_IMU | Fault.IMPLAUSIBLE_IMU, Fault.STALE_IMU | Fault.IMU_TIME
TAKES_OVER = says(Request.LIFE, source=BOSS, priority=200)
FOREIGN = [says(request, Motion.SIT, OTHER, 1) for request in Request if request != Request.EMERGENCY_STOP]
NONSENSE = [operator.nonsense, operator.not_a_number, operator.from_long_ago]

ROWS = (
    Row("a reply missing", buses.no_replies, WALK_ON, at_once, 6 * MS, Fault.MISSING_REPLY, COASTED),
    Row("replies missing", buses.no_replies, DAMP, unanswered, fault=Fault.STALE_MOTOR),
    Row("bus down", buses.bus_down, DAMP, ticks(2), fault=Fault.BUS),
    Row("bus-off", buses.bus_off, DAMP, ticks(3), fault=Fault.BUS),
    Row("bus flooded", buses.bus_flooded, DAMP, unanswered),
    Row("bus full", buses.bus_full, DAMP, ticks(3), fault=Fault.BUS),
    Row("motor fault", buses.drive_error, DAMP, ticks(3), fault=Fault.MOTOR_FAULT),
    Row(
        "motor fault, derated",
        buses.reported_error,
        DERATE,
        derated(ticks(3)),
        fault=Fault.MOTOR_FAULT,
        settings={"safety.motor_fault": "derate"},
    ),
    Row("over-temperature", buses.hot_drive, DERATE, derated(ticks(3)), fault=Fault.TEMPERATURE),
    Row(
        "over-temperature, damped",
        buses.hot_drive,
        DAMP,
        ticks(3),
        fault=Fault.TEMPERATURE,
        settings={"safety.temperature": "damp"},
    ),
    Row("under-voltage", buses.low_battery, DAMP, battery_read, fault=Fault.VOLTAGE),
    Row(
        "under-voltage, derated",
        buses.low_battery,
        DERATE,
        derated(battery_read),
        fault=Fault.VOLTAGE,
        settings={"safety.voltage": "derate"},
    ),
    Row("torque saturated", buses.saturated_drive, DERATE, derated(saturated), fault=Fault.SATURATION),
    Row(
        "torque saturated, damped",
        buses.saturated_drive,
        DAMP,
        saturated,
        fault=Fault.SATURATION,
        settings={"safety.saturation": "damp"},
    ),
    Row("leg out of range", buses.joint_out_of_range, DAMP, ticks(3), fault=Fault.JOINT_POSITION),
    Row("malformed frames", buses.malformed_frames, WALK_ON, at_once, 500 * MS, counted=REJECTED),
    Row("IMU silent", silent(topics.IMU), CROUCH, crouched(imu_stale), fault=Fault.STALE_IMU),
    Row("IMU frozen", sensors.frozen_imu, CROUCH, crouched(imu_frozen), fault=Fault.FROZEN_IMU),
    Row("IMU NaN", sensors.nan_imu, CROUCH, crouched(imu_stale), fault=Fault.STALE_IMU | Fault.NON_FINITE_SENSOR),
    Row("IMU NaN once", sensors.nan_imu, WALK_ON, at_once, 2 * MS, Fault.NON_FINITE_SENSOR, IMU_REJECTED),
    Row("IMU spiking", sensors.spiking_imu, CROUCH, crouched(imu_stale), fault=SPIKING),
    Row("IMU spiking once", sensors.spiking_imu, WALK_ON, at_once, 2 * MS, Fault.IMPLAUSIBLE_IMU, IMU_REJECTED),
    Row(
        "IMU time backwards", sensors.backward_imu, CROUCH, crouched(imu_stale), fault=Fault.STALE_IMU | Fault.IMU_TIME
    ),
    Row(
        "localisation silent",
        silent(topics.LOCALIZATION),
        PAUSE,
        stood(pose_missing),
        3500 * MS,
        Fault.STALE_LOCALIZATION,
    ),
    Row("localisation jumps", sensors.jumping_pose, WALK_ON, at_once, 500 * MS, counted=POSE_REJECTED),
    Row("localisation moved", sensors.jumping_pose, STAND, stood(pose_disputed), fault=Fault.MOVED_LOCALIZATION),
    Row("MPC late 3 periods", late("mpc", 60 * MS), WALK_ON, at_once, 20 * MS, Fault.LATE_FORCES),
    Row("MPC late 400 ms", late("mpc", 400 * MS), PAUSE, plan_missing, 20 * MS, Fault.STALE_FORCES),
    Row("MPC hung", late("mpc", 10**12), ("stand", "damp"), plan_given_up, fault=Fault.STALE_FORCES | Fault.NO_FORCES),
    Row("WBC overrun", late("wbc", 5 * MS), WALK_ON, at_once, 2 * MS, counted=SKIPPED),
    Row("WBC overruns, 3 in a row", late("wbc", 3 * MS), PAUSE, stood(ticks(6)), 12 * MS, Fault.LATE_LOOP, SKIPPED),
    Row("WBC overruns, 5 in a row", late("wbc", 3 * MS), DAMP, overrun, fault=Fault.OVERRUNS, counted=SKIPPED),
    Row("WBC stalls for 15 ms", late("wbc", 15 * MS), WALK_ON, at_once, 2 * MS, counted=SKIPPED),
    Row("rolled over", robot.rolled_over, DAMP, lambda config: 2 * NS_PER_SECOND, fault=Fault.TILT),
    Row("thrown over", robot.pushed_over, DAMP, lambda config: 2 * NS_PER_SECOND, forced=True),
    Row("command not finite", robot.bad_command, DAMP, ticks(1), fault=Fault.NON_FINITE_COMMAND),
    Row(
        "operator silent",
        silent(topics.OPERATOR_EVENT),
        PAUSE,
        stood(lease_over),
        3000 * MS,
        Fault.NO_LEASE,
        mended=operator.walks_again,
    ),
    Row("velocity silent", interrupted(asks_for(0.4, 0.1, 0.3)), STAND, stood(velocity_old)),
    Row(
        "lease released",
        operator_says(says(Request.RELEASE)),
        PAUSE,
        stood(ticks(2)),
        2500 * MS,
        Fault.NO_LEASE,
        mended=operator.walks_again,
    ),
    Row(
        "lease taken over",
        interrupted(TAKES_OVER),
        PAUSE,
        stood(ticks(2)),
        2500 * MS,
        counted=(topics.OPERATOR, "leases"),
        mended=operator.walks_again,
    ),
    Row(
        "emergency stop",
        interrupted(says(Request.EMERGENCY_STOP, source=OTHER, priority=0)),
        DAMP,
        ticks(2),
        fault=Fault.EMERGENCY_STOP,
    ),
    Row("events of others", interrupted(*FOREIGN), WALK_ON, at_once, 100 * MS, counted=REFUSED),
    Row("malformed events", interrupted(*NONSENSE), WALK_ON, at_once, 100 * MS, counted=MALFORMED),
    Row("malformed path", operator.bad_path, WALK_ON, at_once, 100 * MS, counted=PATH_REJECTED),
    Row("path withdrawn by another", path_withdrawn_by(OTHER), WALK_ON, at_once, 100 * MS, counted=PATH_FOREIGN),
)
