# SPDX-License-Identifier: Apache-2.0
"""A vehicle that is asked for more than it may be, or that does not stop as it should, is seen in a trial."""

import numpy as np
import pytest

from runtime.executors.lockstep import Lockstep
from runtime.robots import topics
from runtime.robots.vehicle_4ws4wd.assembly import sizes
from runtime.vehicle_signals import WheelCommand
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.drive import SPEED_MPS, DriveRow
from sim_bridge.faults.drive_bounds import rested, ticks
from sim_bridge.faults.loops import spoiled
from sim_bridge.faults.table_parts import at_once
from sim_bridge.faults.trial import flaws
from sim_bridge.faults.vehicle_table import DRIVE_ON, STOP, VEHICLE_ROWS
from sim_bridge.faults.wheel_limits import WheelLimits
from sim_bridge.run import NullSink, wire
from sim_bridge.simulation import simulation_of

PLAIN = DriveRow("nothing", lambda wires, begin_ns, end_ns: None, DRIVE_ON, at_once)
CONFIG = PLAIN.config
SAFETY, STEP_S = CONFIG.safety, CONFIG.loops.drive_period_ns * 1e-9
RADIUS_M, WHEEL = CONFIG.vehicle.wheel_radius_m, 2
(STOPPED,) = (row for row in VEHICLE_ROWS if row.name == "emergency stop")


def command(angle=0.0, speed=0.0):
    asked = WheelCommand(topics.WHEEL_COMMAND_SAFE, sizes(CONFIG))
    asked.enable, asked.steering[WHEEL], asked.speed[WHEEL] = True, angle, speed
    return asked


def arrived(angle=0.0, speed=0.0):
    return np.array([[angle] * 4, [-speed] * 4])


@pytest.mark.parametrize("place", [command, arrived])
@pytest.mark.parametrize(
    "largest", [{"angle": SAFETY.steering_max_rad}, {"speed": SAFETY.speed_max_mps / RADIUS_M}], ids=["angle", "speed"]
)
def test_each_limit_is_seen_to_be_passed_and_not_before(place, largest):
    for share, kept in ((0.999, True), (1.001, False)):
        values = {name: share * value for name, value in largest.items()}
        asked = command(**values) if place is command else command()
        taken = arrived(**values) if place is arrived else arrived()
        assert WheelLimits(CONFIG).kept(asked, taken) == kept


@pytest.mark.parametrize(
    "step",
    [{"angle": SAFETY.steering_rate_max_radps * STEP_S}, {"speed": SAFETY.brake_mps2 * STEP_S / RADIUS_M}],
    ids=["angle", "speed"],
)
def test_a_change_that_is_too_fast_is_seen_unless_the_wheels_were_without_power(step):
    for share, powered, kept in ((0.999, True, True), (1.001, True, False), (1.001, False, True)):
        limits, before = WheelLimits(CONFIG), command()
        before.enable = powered
        assert limits.kept(before, arrived())
        assert limits.kept(command(**{name: share * value for name, value in step.items()}), arrived()) == kept


def spoils(**fields):
    """A safety whose command is spoiled."""

    def spoil(wires, record):
        for name, value in fields.items():
            setattr(record, name, value)

    return spoiled("safety", topics.WHEEL_COMMAND_SAFE, spoil)


def stopped_but(after_ns, **fields):
    """A vehicle that is stopped, though what leaves its safety says otherwise after a while."""

    def inject(wires, begin_ns, end_ns):
        STOPPED.inject(wires, begin_ns, end_ns)
        spoils(**fields)(wires, begin_ns + after_ns, end_ns)

    return DriveRow("stopped badly", inject, STOP, rested(ticks(2)), fault=STOPPED.fault)


@pytest.mark.parametrize(
    ("row", "flaw"),
    [
        (DriveRow("steered too fast", spoils(steering=0.5), DRIVE_ON, at_once), "a limit was passed"),
        (stopped_but(200_000_000, speed=3.0), "it was driven though damped"),
        (stopped_but(0, enable=True), "it was driven though damped"),
    ],
    ids=["limit", "driven again", "without brakes"],
)
def test_a_trial_that_is_not_as_it_is_to_be_is_told(row, flaw):
    assert flaw in flaws(row, attempt(row, 0), CONFIG)


def test_whenever_a_fault_may_begin_the_vehicle_drives_at_its_speed_straight_or_in_a_bend():
    wired = wire(CONFIG, simulation_of(CONFIG).scenario(PLAIN.course, 0), 0)
    earliest_ns, latest_ns = PLAIN.strikes_ns(CONFIG)
    speeds, angles = [], []

    def look(now_ns):
        if now_ns >= earliest_ns:
            speeds.append(np.hypot(*wired.world.data.qvel[:2]))
            angles.append(wired.world.steering_angles[0])
        return False

    Lockstep(wired.robot.loops, wired.inputs, wired.outputs, wired.world, NullSink()).run(latest_ns, look)
    np.testing.assert_allclose(speeds, SPEED_MPS, atol=0.05)
    assert np.abs(angles).min() < 0.02
    assert np.abs(angles).max() > 0.2
