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
SPEED_MPS, FAST_MPS, STRIKES_NS = 0.6, 1.5, 3_000_000_000
NOTICED_S = 0.3
"""A fault that shows at once is noticed within this; a wheel's steering is stuck only when it is to turn."""
FRONT_LEFT, FRONT_RIGHT, REAR_LEFT, REAR_RIGHT = range(4)
ANSWERS_S = 0.1
"""From a command to what wheels do: frames both ways, the lag of the steering and of the speed control."""
NOISE_RAD = 0.005
"""Of the angle by which a wheel is late, which passes its bound slowly on gentle bends."""
LATER_NS = 250_000_000
"""In which a second wheel of an axle comes to another angle than the first, where the path bends the other way."""


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
def drive(break_it, scenario="flat", ends_ns=5_500_000_000, speed_mps=SPEED_MPS, strikes_ns=STRIKES_NS, later=None):
    """Drive with something broken on the way; what came of it."""
    config = load_configuration("4ws4wd", {"scenario.speed_mps": str(speed_mps)})
    simulation = simulation_of(config)
    wired = wire(config, simulation.scenario(scenario, 0), 0)
    records = {record.topic: record for loop in wired.robot.loops for record in loop.writes}
    executor = Lockstep(wired.robot.loops, wired.inputs, wired.outputs, wired.world, NullSink())
    seen = SimpleNamespace(track=[], stopped_ns=0, unit=wired.world.unit, status=records[topics.SAFETY])
    seen.stuck = records[topics.WHEEL_STATUS]
    seen.wheels, seen.lags, seen.angles = records[topics.WHEEL_STATE], [], []
    command = records[topics.WHEEL_COMMAND_SAFE]

    def look(now_ns):
        if now_ns == strikes_ns:
            break_it(wired)
        if later is not None and now_ns == strikes_ns + LATER_NS:
            later(wired)
        if now_ns >= strikes_ns:
            seen.track.append((*wired.world.position[:2], wired.world.yaw))
            seen.angles.append(wired.world.steering_angles.copy())
            seen.lags.append(np.abs(command.steering - wired.world.steering_angles))
        if seen.status.mode == Mode.DAMPED and not seen.stopped_ns:
            seen.stopped_ns, seen.from_here = now_ns, len(seen.track)
        return False

    executor.run(ends_ns, look)
    return seen


def travelled(track):
    return np.linalg.norm(np.diff(np.array(track)[:, :2], axis=0), axis=1).sum()


def braking_distance(speed_mps=SPEED_MPS):
    return speed_mps**2 / (2.0 * CONFIG.safety.brake_mps2)


@pytest.mark.parametrize(
    ("break_it", "fault"),
    [
        (no_answer, Fault.STALE_MOTOR),
        (motor_fault, Fault.MOTOR_FAULT),
        (steering_fault, Fault.STUCK_STEERING),
        (damaged_states, Fault.STALE_MOTOR),
        (stalled_states, Fault.STALE_MOTOR),
        (lost_bus, Fault.BUS),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
@pytest.mark.parametrize("speed_mps", [SPEED_MPS, FAST_MPS])
def test_it_stops_within_its_braking_distance_and_says_why(break_it, fault, speed_mps):
    seen = drive(break_it, speed_mps=speed_mps)
    assert seen.status.mode == Mode.DAMPED
    assert seen.status.fault & fault
    assert 0 < seen.stopped_ns - STRIKES_NS <= NOTICED_S * 1e9
    assert travelled(seen.track) < NOTICED_S * speed_mps + braking_distance(speed_mps) + 0.05
    assert abs(seen.track[-1][1]) < 0.05
    assert np.linalg.norm(np.subtract(seen.track[-1], seen.track[-100])) < 1e-3
    assert seen.unit.mode != UnitMode.DRIVE


def test_damaged_and_stalled_states_are_told_apart():
    damaged, stalled = drive(damaged_states), drive(stalled_states)
    assert damaged.wheels.corrupt > 100
    assert damaged.wheels.stalled == 0
    assert stalled.wheels.stalled > 100
    assert stalled.wheels.corrupt == 0


@pytest.mark.parametrize("speed_mps", [SPEED_MPS, FAST_MPS])
def test_commands_that_arrive_damaged_are_not_obeyed_and_the_unit_brakes_by_itself(speed_mps):
    seen = drive(damaged_commands, speed_mps=speed_mps)
    assert seen.status.fault & Fault.MOTOR_FAULT
    assert seen.unit.mode == UnitMode.TIMED_OUT
    assert travelled(seen.track) < 0.2 * speed_mps + speed_mps**2 / (2.0 * 0.5 * 9.81 * 0.9) + 0.05
    assert seen.wheels.mode == UnitMode.TIMED_OUT


def test_one_that_cannot_steer_a_wheel_stops_as_straight_as_it_can():
    seen = drive(lambda wired: wired.world.unit.jam(FRONT_LEFT), "slalom", ends_ns=6_500_000_000)
    assert seen.status.mode == Mode.DAMPED
    assert seen.status.fault & Fault.STUCK_STEERING
    assert seen.stuck.stuck.tolist() == [True, False, False, False]
    assert simulation_of(CONFIG).broken({topics.WHEEL_STATUS: seen.stuck}) == ["front left wheel stuck"]
    assert seen.stopped_ns < 6_000_000_000
    stop = np.array(seen.track[seen.from_here :])
    assert travelled(stop) < braking_distance() + 0.1
    assert abs(stop[-1, 2] - stop[0, 2]) < 0.05
    assert np.linalg.norm(stop[-1] - stop[-50]) < 1e-3


def jam(wheel):
    return lambda wired: wired.world.unit.jam(wheel)


@pytest.mark.parametrize("speed_mps", [SPEED_MPS, FAST_MPS])
@pytest.mark.parametrize("axle", [(FRONT_LEFT, FRONT_RIGHT), (REAR_LEFT, REAR_RIGHT)], ids=["front", "rear"])
@pytest.mark.parametrize("strikes_ns", [STRIKES_NS, 4_000_000_000])
def test_one_that_cannot_steer_an_axle_stops_within_its_braking_distance_as_straight_as_it_can(
    axle, speed_mps, strikes_ns
):
    """Both wheels get stuck, one after the other.

    They are noticed a while after they do not turn with the others; the vehicle then stops within v^2 / (2 a), with v
    the fastest that it went meanwhile, besides what it goes before its wheels answer. Meanwhile the other axle turns
    parallel, from an angle D to the stuck one, so that the vehicle turns at v D / L at first and not at all in the end;
    but where stuck wheels point apart by A, and only one of them has been noticed so far, at worst the other leads.
    """
    first, second = axle
    seen = drive(jam(first), "slalom", 7_500_000_000, speed_mps, strikes_ns, jam(second))
    assert seen.status.mode == Mode.DAMPED
    assert seen.status.fault & Fault.STUCK_STEERING
    simulation, noticed = CONFIG.simulation, seen.from_here
    late = np.array(seen.lags)[:noticed, axle] > simulation.stuck_error_rad + NOISE_RAD
    late_ticks = np.argmin(late[::-1], axis=0)
    tick_s = CONFIG.loops.drive_period_ns * 1e-9
    assert late[-1].any()
    assert late_ticks.max() * tick_s <= simulation.stuck_ns * 1e-9 + ANSWERS_S

    stop, angles = np.array(seen.track[noticed:]), np.array(seen.angles[noticed])
    steps = np.diff(np.array(seen.track[noticed - late_ticks.max() : noticed + 1])[:, :2], axis=0)
    speed = np.hypot(*steps.T).max() / tick_s
    assert travelled(stop) < braking_distance(speed) + ANSWERS_S * speed
    apart, free = abs(angles[first] - angles[second]), np.delete(angles, axle).mean()
    turn = np.abs(angles[list(axle)] - free).max()
    turning_s = ANSWERS_S + 0.5 * turn / simulation.steering_rate_radps
    bound = (speed * turn * turning_s + travelled(stop) * apart) / CONFIG.vehicle.wheelbase_m
    assert abs(stop[-1, 2] - stop[0, 2]) < bound + 0.01
    assert np.linalg.norm(stop[-1] - stop[-50]) < 1e-3
