# SPDX-License-Identifier: Apache-2.0
"""What the control unit says becomes wheel state and battery, and a wheel command becomes frames it obeys."""

import numpy as np
import pytest

from drivers.can_frame import as_frames
from drivers.vcu import COMMAND_FRAMES, Counter, UnitCommandMode, UnitMode
from runtime.robots import load_configuration
from runtime.robots.unit_tasks import DecodeUnitTask, EncodeUnitTask, braking_frames
from runtime.robots.vehicle_4ws4wd.assembly import sizes
from runtime.signals import Battery, CanFrames
from runtime.vehicle_signals import WheelCommand, WheelState
from sim_bridge.run import wire
from sim_bridge.simulation import simulation_of

CONFIG = load_configuration("4ws4wd")
SIZES = sizes(CONFIG)
TICK_NS = CONFIG.loops.drive_period_ns


class Ends:
    """Both tasks on the wires of a simulated vehicle that stands."""

    def __init__(self):
        simulation = simulation_of(CONFIG)
        wired = wire(CONFIG, simulation.scenario("stand", 0), 0)
        self.world, self.reader = wired.world, wired.inputs["/ugv/can_received"]
        self.writer = wired.outputs["/ugv/can_sent"]
        self.received, self.sent = CanFrames("/received", SIZES), CanFrames("/sent", SIZES)
        self.wheels, self.battery = WheelState("/wheels", SIZES), Battery("/battery")
        self.command = WheelCommand("/command", SIZES)
        self.decode = DecodeUnitTask(CONFIG.drives.unit(), self.received, self.wheels, self.battery)
        self.encode = EncodeUnitTask(CONFIG.drives.unit(), self.command, self.sent)
        self.now_ns = 0

    def tick(self):
        self.now_ns += TICK_NS
        self.world.advance(self.now_ns)
        self.reader.read(self.received, self.now_ns)
        self.decode.step(self.now_ns)
        self.command.stamp_ns = self.now_ns
        self.encode.step(self.now_ns)
        self.writer.write(self.sent, self.now_ns)


@pytest.fixture
def ends():
    return Ends()


def ticks(ends, count):
    for _ in range(count):
        ends.tick()


def test_the_unit_is_heard(ends):
    ticks(ends, 20)
    assert ends.now_ns - ends.wheels.reply_ns[:5].min() <= 2 * TICK_NS
    assert ends.wheels.rejected == ends.wheels.corrupt == ends.wheels.stalled == 0
    assert ends.battery.voltage == pytest.approx(CONFIG.simulation.battery_v, abs=0.5)
    assert np.isfinite(ends.wheels.temperature).all()


def test_a_command_is_obeyed(ends):
    ends.command.enable = True
    ticks(ends, 10)  # braking first: a unit that was off drives only after that
    assert ends.wheels.enabled
    ends.command.mode, ends.command.steering = UnitCommandMode.DRIVE, 0.3
    ticks(ends, 150)
    assert ends.wheels.steering == pytest.approx(0.3, abs=0.02)
    assert not ends.wheels.fault.any()


def test_a_set_of_commands_is_sent_each_tick(ends):
    ticks(ends, 3)
    assert ends.sent.count == COMMAND_FRAMES
    assert ends.sent.stamp_ns == ends.now_ns
    assert len(set(as_frames(ends.sent.data)["can_id"][:COMMAND_FRAMES].tolist())) == COMMAND_FRAMES


def test_a_restored_encoder_goes_on_counting(ends):
    ticks(ends, 5)
    saved = ends.encode.save()
    ends.encode.step(ends.now_ns)
    bytes_then = ends.sent.to_bytes()
    other = EncodeUnitTask(CONFIG.drives.unit(), ends.command, ends.sent)
    other.restore(saved)
    other.step(ends.now_ns)
    assert ends.sent.to_bytes() == bytes_then


def test_damaged_states_are_counted(ends):
    ticks(ends, 5)
    ends.now_ns += TICK_NS
    ends.world.advance(ends.now_ns)
    ends.reader.read(ends.received, ends.now_ns)
    frames = as_frames(ends.received.data)
    frames["data"][0, 1] ^= 0xFF
    ends.decode.step(ends.now_ns)
    assert ends.wheels.corrupt == 1


@pytest.mark.parametrize("sent", range(16))
def test_what_the_unit_is_told_last_brakes_whatever_was_told_before(ends, sent):
    ends.command.enable = True
    ends.encode.state.counters[Counter.SENT] = sent
    ticks(ends, 10)
    ends.command.mode, ends.command.speed = UnitCommandMode.DRIVE, 1.0
    ticks(ends, 20)
    unit = ends.world.unit
    assert unit.mode == UnitMode.DRIVE
    ends.writer.write(braking_frames(CONFIG.drives.unit(), CanFrames("/last", SIZES)), ends.now_ns)
    ends.world.advance(ends.now_ns + 5_000_000)
    assert unit.mode == UnitMode.OFF
    assert not unit.timed_out
