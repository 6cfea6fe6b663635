# SPDX-License-Identifier: Apache-2.0
"""The faults that are tried in real time, on the wires and beside them, with their answers."""

from __future__ import annotations

from typing import Any

from runtime.link.loop import STATUS
from runtime.recording.recorder_status import RecorderStatus
from runtime.robots import topics
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Fault, Motion, Request
from sim_bridge.faults import stage
from sim_bridge.faults.live_row import LINGER_NS, LiveRow, Need
from sim_bridge.faults.operator import asks_for, insert, interrupted, says
from sim_bridge.faults.stage import continued, killed, started_again, stopped
from sim_bridge.faults.table import (
    CROUCH,
    DAMP,
    PAUSE,
    ROWS,
    WALK_ON,
    Bound,
    crouched,
    plan_given_up,
    plan_missing,
    stood,
    ticks,
)
from sim_bridge.faults.table_parts import MS, SKIPPED, at_once, imu_stale, lease_over, velocity_old
from sim_bridge.faults.wires import QuadrupedWires
from sim_bridge.live_world import LONGEST_LAG_NS

CARRIED_NS = 30 * MS
"""What the way through link and simulator may take, each with a period of 10 ms, beside the bound of virtual time."""
BUS_BACK_NS = 300 * MS
"""After so long a bus that was lost is back, so that the robot can be reset."""
OVERRUN_NS, OVERRUNS = 4 * MS, 20
"""How long the fast loop is held before a tick, and before how many; between two of them one may come on time."""
DERATES = {"safety.motor_fault": "derate", "safety.voltage": "derate"}
DAMPS = {"safety.temperature": "damp", "safety.saturation": "damp"}
"""Configured answers that one robot each shows."""
REJECTED_MESSAGES = (STATUS, "rejected")


def carried(bound: Bound) -> Bound:
    """What virtual time bounds, and the way there."""
    return lambda config: bound(config) + CARRIED_NS


def let_go_in_real_time(config: Uslgo1Config) -> int:
    """Until drives that hear nothing damp by themselves, in a world that may be a little late."""
    in_time_ns = config.simulation.command_timeout_ns + config.simulation.time_step_ns + config.loops.wbc_period_ns
    return in_time_ns + LONGEST_LAG_NS


def on_the_wires(name: str, **changes: Any) -> LiveRow:
    """A row of virtual time, injected by the same definition."""
    (row,) = (row for row in ROWS if row.name == name)
    bound = row.bound_ns if row.bound_ns is at_once else carried(row.bound_ns)
    after_ns = 2000 * MS if "go on" in row.answer else LINGER_NS
    same: dict[str, Any] = {
        "inject": row.inject,
        "lasts_ns": row.lasts_ns,
        "after_ns": after_ns,
        "fault": row.fault,
        "counted": row.counted,
        "settings": row.settings,
    }
    return LiveRow(name, row.answer, bound, **{**same, **changes})


def clock_ahead(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The clock of the computer that reads the IMU is set a second ahead."""

    def change(imu: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            imu.stamp_ns += 1000 * MS
        return True

    wires.filter(topics.IMU, change)


def velocity_lapses(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The operator asks for a velocity and says no more of it, and at the end asks to walk along the path again."""
    interrupted(asks_for(0.4, 0.1, 0.3))(wires, begin_ns, end_ns)
    anew = [says(Request.MOTION, motion) for motion in (Motion.STAND, Motion.WALK)]
    insert(wires, topics.OPERATOR_EVENT, end_ns, anew)


def overrun_again_and_again(config: Uslgo1Config) -> int:
    """Until a loop that was held so often, and took a tick or two in between, has overrun often enough."""
    return OVERRUNS * (OVERRUN_NS + 2 * config.loops.wbc_period_ns)


def _failed(status: RecorderStatus) -> bool:
    return not status.recording and bool(status.error)


LIVE_ROWS = (
    on_the_wires("a reply missing"),
    on_the_wires("replies missing"),
    on_the_wires("bus down"),
    on_the_wires("bus-off", lasts_ns=BUS_BACK_NS),
    on_the_wires("bus flooded", lasts_ns=BUS_BACK_NS),
    on_the_wires("malformed frames"),
    on_the_wires("motor fault"),
    on_the_wires("motor fault, derated", settings=DERATES),
    on_the_wires("over-temperature"),
    on_the_wires("over-temperature, damped", settings=DAMPS),
    on_the_wires("torque saturated"),
    on_the_wires("torque saturated, damped", settings=DAMPS),
    on_the_wires("leg out of range"),
    on_the_wires("under-voltage"),
    on_the_wires("under-voltage, derated", settings=DERATES),
    on_the_wires("IMU silent"),
    on_the_wires("IMU frozen"),
    on_the_wires("IMU NaN", fault=Fault.STALE_IMU, counted=REJECTED_MESSAGES),
    on_the_wires("IMU NaN once", lasts_ns=4 * MS, fault=Fault.NONE, counted=REJECTED_MESSAGES),
    on_the_wires("IMU spiking"),
    on_the_wires("IMU time backwards", fault=Fault.STALE_IMU, counted=REJECTED_MESSAGES),
    LiveRow(
        "IMU's clock a second ahead",
        CROUCH,
        carried(crouched(imu_stale)),
        clock_ahead,
        fault=Fault.STALE_IMU,
        counted=REJECTED_MESSAGES,
    ),
    on_the_wires("localisation silent"),
    on_the_wires("localisation jumps"),
    on_the_wires("localisation moved"),
    LiveRow(
        "WBC held for 8 ms",
        WALK_ON,
        act=stage.loop_held_for("wbc", 0.008),
        lasts_ns=500 * MS,
        counted=SKIPPED,
        holds_up=("wbc", "mpc"),
    ),
    LiveRow(
        "WBC held for 4 ms, again and again",
        DAMP,
        overrun_again_and_again,
        act=stage.loop_held_again_and_again("wbc", OVERRUN_NS * 1e-9, OVERRUNS),
        lasts_ns=500 * MS,
        fault=Fault.OVERRUNS,
        counted=SKIPPED,
        holds_up=("wbc", "mpc"),
    ),
    LiveRow(
        "MPC held for 60 ms",
        WALK_ON,
        act=stage.loop_held_for("mpc", 0.060),
        lasts_ns=500 * MS,
        fault=Fault.LATE_FORCES,
        holds_up=("mpc",),
    ),
    LiveRow(
        "MPC held for 400 ms",
        PAUSE,
        carried(plan_missing),
        act=stage.loop_held("mpc"),
        mend=stage.released,
        lasts_ns=400 * MS,
        after_ns=2000 * MS,
        fault=Fault.STALE_FORCES,
        holds_up=("mpc",),
    ),
    LiveRow(
        "MPC held for good",
        ("stand", "damp"),
        carried(plan_given_up),
        act=stage.loop_held("mpc"),
        mend=stage.released,
        fault=Fault.STALE_FORCES | Fault.NO_FORCES,
        holds_up=("mpc",),
    ),
    on_the_wires("operator silent"),
    LiveRow(
        "velocity silent for 3 s",
        PAUSE,
        carried(stood(velocity_old)),
        velocity_lapses,
        lasts_ns=3000 * MS,
        after_ns=2500 * MS,
    ),
    on_the_wires("lease released"),
    LiveRow(
        "lease held by another",
        PAUSE,
        carried(stood(ticks(2))),
        prepare=stage.teleoperator_ready,
        act=stage.lease_taken_over,
        mend=stage.released,
        lasts_ns=2500 * MS,
        after_ns=2500 * MS,
        counted=(topics.OPERATOR, "leases"),
    ),
    on_the_wires("emergency stop"),
    on_the_wires("malformed path", lasts_ns=300 * MS, counted=REJECTED_MESSAGES),
    LiveRow(
        "malformed messages",
        WALK_ON,
        act=stage.malformed_messages,
        mend=stage.released,
        lasts_ns=500 * MS,
        counted=REJECTED_MESSAGES,
    ),
    LiveRow(
        "operator partitioned",
        PAUSE,
        carried(stood(lease_over)),
        act=stage.partitioned,
        mend=stage.healed,
        lasts_ns=3000 * MS,
        after_ns=2500 * MS,
        fault=Fault.NO_LEASE,
    ),
    LiveRow(
        "subscribers flood",
        WALK_ON,
        act=stage.flooded_by_subscribers,
        mend=stage.released,
        lasts_ns=2000 * MS,
    ),
    LiveRow(
        "link killed",
        CROUCH,
        carried(crouched(imu_stale)),
        act=killed("link"),
        mend=started_again("link"),
        fault=Fault.STALE_IMU,
        holds_up=("link",),
    ),
    LiveRow(
        "link stopped",
        CROUCH,
        carried(crouched(imu_stale)),
        act=stopped("link"),
        mend=continued("link"),
        fault=Fault.STALE_IMU,
        holds_up=("link",),
    ),
    LiveRow(
        "control killed",
        DAMP,
        let_go_in_real_time,
        act=killed("control"),
        mend=started_again("control"),
        holds_up=("wbc", "mpc"),
    ),
    LiveRow(
        "control stopped, goes on",
        DAMP,
        let_go_in_real_time,
        act=stopped("control"),
        mend=continued("control"),
        fault=Fault.STOOD_STILL,
        holds_up=("wbc", "mpc"),
        breaks_log=True,
    ),
    LiveRow(
        "control hung, killed",
        DAMP,
        let_go_in_real_time,
        act=stopped("control"),
        mend=started_again("control"),
        holds_up=("wbc", "mpc"),
    ),
    LiveRow("recorder killed", WALK_ON, act=killed("recorder"), mend=started_again("recorder"), lasts_ns=300 * MS),
    LiveRow(
        "recorder stopped for 3 s",
        WALK_ON,
        act=stopped("recorder"),
        mend=continued("recorder"),
        lasts_ns=3000 * MS,
        after_ns=1500 * MS,
        breaks_log=True,
    ),
    LiveRow(
        "disk full",
        WALK_ON,
        act=stage.disk_full,
        mend=stage.disk_freed,
        lasts_ns=3000 * MS,
        after_ns=2500 * MS,
        recorder=_failed,
        needs=Need.DISK,
        breaks_log=True,
    ),
    LiveRow(
        "log directory gone",
        WALK_ON,
        act=stage.logs_gone,
        mend=stage.logs_back,
        lasts_ns=2000 * MS,
        after_ns=2500 * MS,
        recorder=lambda status: status.failed > 0,
        breaks_log=True,
    ),
    LiveRow(
        "clock set a minute ahead, and back",
        WALK_ON,
        act=stage.clock_ahead,
        mend=stage.released,
        lasts_ns=2000 * MS,
        after_ns=1500 * MS,
        counted=(STATUS, "clock_steps"),
        needs=Need.CLOCK,
    ),
    LiveRow(
        "suspended for 1 s",
        DAMP,
        lambda config: 1000 * MS + crouched(imu_stale)(config) + CARRIED_NS,
        act=stopped(*stage.EVERYONE),
        mend=continued(*stage.EVERYONE),
        fault=Fault.STOOD_STILL,
        lasts_ns=1000 * MS,
        after_ns=1500 * MS,
        before=("crouch",),
        holds_up=("wbc", "mpc", "link", "sim"),
        breaks_log=True,
    ),
    on_the_wires("rolled over"),  # the last, since it does not get up again
)
