# SPDX-License-Identifier: Apache-2.0
"""Each fault is excused only by a stall beyond its own bound, which follows from how safety finds it."""

from functools import cache

import pytest

from runtime.recording.fault_events import judged
from runtime.recording.stalls import Stall
from runtime.robots import load_configuration
from runtime.signals import Fault
from sim_bridge.simulation import simulation_of

MS = 1_000_000
AT_NS = 10_000 * MS

STALLS = [
    # 20 ms of age, of which a sample is 2 ms old when the next is due, and that 2 ms on its way
    ("uslgo1", Fault.STALE_IMU, "sim", 16),
    ("uslgo1", Fault.STALE_IMU, "link", 16),
    ("4ws4wd", Fault.STALE_IMU, "link", 16),
    # 1 s of age, of which a pose is 80 ms old when it comes, 100 ms more when the next is due, and 2 ms on its way
    ("uslgo1", Fault.STALE_LOCALIZATION, "sim", 818),
    ("4ws4wd", Fault.STALE_LOCALIZATION, "link", 818),
    # 0.5 s without a sign of life, which comes each 100 ms, and is 2 ms on its way; a kept loop takes the oldest first
    ("uslgo1", Fault.STALE_OPERATOR, "link", 398),
    ("uslgo1", Fault.NO_LEASE, "wbc", 398),
    ("4ws4wd", Fault.STALE_OPERATOR, "drive", 398),
    ("4ws4wd", Fault.NO_LEASE, "sim", 398),
    # drives wait 20 ms (100 ms) for commands, which come each 2 ms (10 ms)
    ("uslgo1", Fault.STOOD_STILL, "wbc", 18),
    ("4ws4wd", Fault.STOOD_STILL, "drive", 90),
    # three or five ticks that take longer than 2 ms (10 ms), of which the loop itself needs 0.8 ms (3 ms)
    ("uslgo1", Fault.LATE_LOOP, "wbc", 3.6),
    ("uslgo1", Fault.OVERRUNS, "wbc", 6),
    ("4ws4wd", Fault.LATE_LOOP, "drive", 21),
    ("4ws4wd", Fault.OVERRUNS, "drive", 35),
    # three ticks of 2 ms are bridged, so that it is the fourth that misses its reply; one passes until the next is due
    ("uslgo1", Fault.STALE_MOTOR, "sim", 6),
    # a read takes 12 frames of a bus, which are the replies of its 3 drives to 4 ticks of 2 ms; commands leave within
    # 0.8 ms of their tick, and wait for a step of 1 ms
    ("uslgo1", Fault.BUS, "sim", 6.2),
    # plans of 20 ms that hold from their stamp on
    ("uslgo1", Fault.STALE_FORCES, "mpc", 180),
    ("uslgo1", Fault.NO_FORCES, "mpc", 680),
    # commands of 40 ms that are seen 10 ms after their stamp, or of 20 ms that are seen at once
    ("uslgo1", Fault.STALE_BODY_COMMAND, "mpc", 150),
    ("4ws4wd", Fault.STALE_BODY_COMMAND, "drive", 180),
    # states each 10 ms may be 50 ms old
    ("4ws4wd", Fault.STALE_MOTOR, "sim", 40),
    # a read takes 64 frames, 5 of each 10 ms; after that the newest that it takes is old
    ("4ws4wd", Fault.BUS, "drive", 120),
    ("4ws4wd", Fault.STALE_MOTOR, "drive", 160),
    # the unit waits 100 ms for commands, which come each 10 ms
    ("4ws4wd", Fault.MOTOR_FAULT, "drive", 90),
    # a wheel that was seen to turn in the tick before may take 0.5 s
    ("4ws4wd", Fault.STUCK_STEERING, "drive", 490),
]
NEVER = {
    "uslgo1": (Fault.MOTOR_FAULT, Fault.STUCK_STEERING),
    "4ws4wd": (Fault.STALE_FORCES, Fault.NO_FORCES),
}
BY_NO_STALL = (
    Fault.NONE,
    Fault.TILT,
    Fault.NON_FINITE_COMMAND,
    Fault.NON_FINITE_SENSOR,
    Fault.TEMPERATURE,
    Fault.VOLTAGE,
    Fault.JOINT_POSITION,
    Fault.JOINT_VELOCITY,
    Fault.EMERGENCY_STOP,
    Fault.SATURATION,
    Fault.FROZEN_IMU,
    Fault.IMPLAUSIBLE_IMU,
    Fault.IMU_TIME,
    Fault.MOVED_LOCALIZATION,
)
BRIDGED = Fault.MISSING_REPLY | Fault.LATE_FORCES


@cache
def bounds_of(robot):
    return simulation_of(load_configuration(robot)).stall_bounds()


def excuses(robot, fault, loop, stall_ms):
    length_ns = round(stall_ms * MS)
    bounds = [bound for bound in bounds_of(robot) if bound.fault == fault and loop in bound.loops]
    return judged(fault, fault, AT_NS, bounds, [Stall(loop, AT_NS - length_ns, length_ns)]).stall is not None


@pytest.mark.parametrize(("robot", "fault", "loop", "bound_ms"), STALLS)
def test_a_stall_excuses_a_fault_beyond_its_bound_and_not_below(robot, fault, loop, bound_ms):
    assert not excuses(robot, fault, loop, bound_ms - 0.1)
    assert not excuses(robot, fault, loop, bound_ms)
    assert excuses(robot, fault, loop, bound_ms + 0.1)


@pytest.mark.parametrize("robot", NEVER)
def test_what_no_stall_makes_no_stall_excuses(robot):
    for fault in (*BY_NO_STALL, *NEVER[robot]):
        stalls = [Stall(loop, 0, AT_NS) for loop in ("sim", "link", "wbc", "mpc", "drive")]
        event = judged(fault, fault, AT_NS, bounds_of(robot), stalls)
        assert (event.bound, event.stall) == (None, None), fault.name


@pytest.mark.parametrize("robot", NEVER)
def test_every_fault_either_has_a_bound_or_has_none_for_a_reason(robot):
    decided = {bound.fault for bound in bounds_of(robot)}
    assert decided == {fault for name, fault, *_ in STALLS if name == robot}
    decided |= {*BY_NO_STALL, *NEVER[robot]}
    assert {fault for fault in Fault if fault not in BRIDGED} <= decided


def test_a_unit_that_gave_up_waiting_is_a_fault_only_after_its_refusal_was_borne():
    stall = Stall("drive", AT_NS - 420 * MS, 101 * MS)
    assert judged(Fault.MOTOR_FAULT, Fault.MOTOR_FAULT, AT_NS, bounds_of("4ws4wd"), [stall]).stall is not None
    long_ago = stall._replace(at_ns=AT_NS - 600 * MS)
    assert judged(Fault.MOTOR_FAULT, Fault.MOTOR_FAULT, AT_NS, bounds_of("4ws4wd"), [long_ago]).stall is None


def test_the_bounds_follow_the_configuration():
    config = load_configuration("uslgo1", {"safety.imu_age_max_ns": "30000000", "safety.missing_replies_max": "5"})
    found = {bound.fault: bound.bound_ns for bound in simulation_of(config).stall_bounds()}
    assert found[Fault.STALE_IMU] == 26 * MS
    assert found[Fault.STALE_MOTOR] == 10 * MS


def test_a_wait_as_short_as_what_is_usual_still_needs_a_stall():
    config = load_configuration("uslgo1", {"safety.imu_age_max_ns": "3000000"})
    bounds = simulation_of(config).stall_bounds()
    assert judged(Fault.STALE_IMU, Fault.STALE_IMU, AT_NS, bounds, []).stall is None
