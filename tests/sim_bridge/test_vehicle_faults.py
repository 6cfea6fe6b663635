# SPDX-License-Identifier: Apache-2.0
"""The vehicle drives by its own wires, something breaks, and it stops within its braking distance and says why."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.memory_bus import End
from drivers.vcu import UnitMode, WheelFault
from runtime.executors.lockstep import Lockstep
from runtime.robots import load_configuration, topics
from runtime.signals import Fault, Mode
from sim_bridge.run import NullSink, wire
from sim_bridge.simulation import simulation_of

CONFIG = load_configuration("4ws4wd")
SPEED_MPS, STRIKES_NS = 0.6, 3_000_000_000
NOTICED_S = 0.3
"""A fault that shows at once is noticed within this; a wheel's steering is stuck only when it is to turn."""
FRONT_LEFT, REAR_RIGHT = 0, 3


def no_answer(wired):
    wired.world.unit.mute(REAR_RIGHT)


def motor_fault(wired):
    wired.world.unit.force_fault(4 + FRONT_LEFT, WheelFault.OVER_CURRENT)


def steering_fault(wired):
    wired.world.unit.force_fault(FRONT_LEFT, WheelFault.ENCODER)


def damaged(frame):
    return frame[:10] + bytes([frame[10] ^ 0x55]) + frame[11:]


def damaged_states(wired):
    wired.bus.tamper = lambda sender, bus, at_ns, frame: frame if sender == End.HOST else damaged(frame)


def stalled_states(wired):
    first = {}
    wired.bus.tamper = lambda sender, bus, at_ns, frame: (
        frame if sender == End.HOST else first.setdefault(frame[:4], frame)
    )


def damaged_commands(wired):
    wired.bus.tamper = lambda sender, bus, at_ns, frame: frame if sender == End.DEVICE else damaged(frame)


def lost_bus(wired):
    wired.bus.take_down(0)


@cache
def drive(break_it, scenario="flat", ends_ns=5_500_000_000):
    """Drive with something broken on the way; what came of it."""
    simulation = simulation_of(CONFIG)
    wired = wire(CONFIG, simulation.scenario(scenario, 0), 0)
    records = {record.topic: record for loop in wired.robot.loops for record in loop.writes}
    executor = Lockstep(wired.robot.loops, wired.inputs, wired.outputs, wired.world, NullSink())
    seen = SimpleNamespace(track=[], stopped_ns=0, unit=wired.world.unit, status=records[topics.SAFETY])
    seen.wheels = records[topics.WHEEL_STATE]

    def look(now_ns):
        if now_ns == STRIKES_NS:
            break_it(wired)
        if now_ns >= STRIKES_NS:
            seen.track.append((*wired.world.position[:2], wired.world.yaw))
        if seen.status.mode == Mode.DAMPED and not seen.stopped_ns:
            seen.stopped_ns, seen.from_here = now_ns, len(seen.track)
        return False

    executor.run(ends_ns, look)
    return seen


def travelled(track):
    return np.linalg.norm(np.diff(np.array(track)[:, :2], axis=0), axis=1).sum()


def braking_distance():
    return SPEED_MPS**2 / (2.0 * CONFIG.safety.brake_mps2)


@pytest.mark.parametrize(
    ("break_it", "fault"),
    [
        (no_answer, Fault.STALE_MOTOR),
        (motor_fault, Fault.MOTOR_FAULT),
        (steering_fault, Fault.JOINT_POSITION),
        (damaged_states, Fault.STALE_MOTOR),
        (stalled_states, Fault.STALE_MOTOR),
        (lost_bus, Fault.BUS),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_it_stops_within_its_braking_distance_and_says_why(break_it, fault):
    seen = drive(break_it)
    assert seen.status.mode == Mode.DAMPED
    assert seen.status.fault & fault
    assert 0 < seen.stopped_ns - STRIKES_NS <= NOTICED_S * 1e9
    assert travelled(seen.track) < NOTICED_S * SPEED_MPS + braking_distance() + 0.05
    assert abs(seen.track[-1][1]) < 0.05
    assert np.linalg.norm(np.subtract(seen.track[-1], seen.track[-100])) < 1e-3
    assert seen.unit.mode != UnitMode.DRIVE


def test_damaged_and_stalled_states_are_told_apart():
    damaged, stalled = drive(damaged_states), drive(stalled_states)
    assert damaged.wheels.corrupt > 100
    assert damaged.wheels.stalled == 0
    assert stalled.wheels.stalled > 100
    assert stalled.wheels.corrupt == 0


def test_commands_that_arrive_damaged_are_not_obeyed_and_the_unit_brakes_by_itself():
    seen = drive(damaged_commands)
    assert seen.status.fault & Fault.MOTOR_FAULT
    assert seen.unit.mode == UnitMode.TIMED_OUT
    assert travelled(seen.track) < 0.2 * SPEED_MPS + SPEED_MPS**2 / (2.0 * 0.5 * 9.81 * 0.9) + 0.05
    assert seen.wheels.mode == UnitMode.TIMED_OUT


def test_one_that_cannot_steer_a_wheel_stops_as_straight_as_it_can():
    seen = drive(lambda wired: wired.world.unit.jam(FRONT_LEFT), "slalom", ends_ns=6_500_000_000)
    assert seen.status.mode == Mode.DAMPED
    assert seen.status.fault & Fault.JOINT_POSITION
    assert seen.stopped_ns < 6_000_000_000
    stop = np.array(seen.track[seen.from_here :])
    assert travelled(stop) < braking_distance() + 0.1
    assert abs(stop[-1, 2] - stop[0, 2]) < 0.05
    assert np.linalg.norm(stop[-1] - stop[-50]) < 1e-3
