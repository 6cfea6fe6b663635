# SPDX-License-Identifier: Apache-2.0
"""Command in, torque out, and back: all of it through encoded frames on a bus."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.can_frame import as_frames
from drivers.dialects import dialect_named
from drivers.joint_group import Counter, JointGroup
from drivers.memory_bus import End, MemoryBus
from drivers.memory_ports import MemoryReader, MemoryWriter
from drivers.mit import ENABLE
from runtime import signals
from runtime.robots import load_configuration
from runtime.robots.fresh_frames import FreshFrames
from runtime.robots.motor_tasks import DecodeTask, EncodeTask, damping_frames
from runtime.robots.uslgo1.assembly import sizes
from runtime.signals import Mode
from sim_bridge.quadruped_world import drive_model
from sim_bridge.virtual_drive import VirtualDrives

CONFIG = load_configuration("uslgo1")
SIZES = sizes(CONFIG)
JOINTS = CONFIG.drives.joints(CONFIG.safety)
DIALECT = dialect_named(CONFIG.drives.dialect)
MS = 1_000_000
QUIET = dataclasses.replace(drive_model(CONFIG.simulation), velocity_noise=0.0)
ANGLES = CONFIG.quadruped.standing_angles(0.29)


class Rig:
    """Both motor tasks, the wire, and drives on joints that are held where they are."""

    def __init__(self, tamper=None):
        self.bus = MemoryBus(CONFIG.drives.buses, CONFIG.drives.bit_rate_hz, tamper=tamper)
        self.received, self.sent = (signals.CanFrames(topic, SIZES) for topic in ("/received", "/sent"))
        self.joints, self.command = signals.JointState("/joints", SIZES), signals.JointCommand("/command", SIZES)
        self.status, self.operator = signals.SafetyStatus("/status"), signals.OperatorRequest("/operator")
        groups = [JointGroup(JOINTS, DIALECT, CONFIG.drives.command_age_max_ns) for _ in range(2)]
        self.decode = DecodeTask(groups[0], self.received, self.joints)
        self.encode = EncodeTask(groups[1], self.command, self.status, self.operator, self.sent)
        self.drives = VirtualDrives(JOINTS, DIALECT, QUIET, 0)
        self.reader, self.writer = MemoryReader(self.bus), MemoryWriter(self.bus)
        self.angles, self.rates = ANGLES.copy(), np.zeros(12)
        self.now_ns, self.history = 0, []
        self.tick(Mode.OFF)

    def tick(self, mode=Mode.ACTIVE):
        """2 ms: a physics step, a tick of the loop, another physics step."""
        for half in range(2):
            torque = self.drives.torque(self.angles, self.rates, self.now_ns).copy()
            arrived = self.bus.receive(End.DEVICE, self.now_ns)
            if len(arrived.bus):
                frames, bus, at = self.drives.answer(*arrived)
                self.bus.send(End.DEVICE, bus, frames, at)
            if not half:
                self.reader.read(self.received, self.now_ns)
                self.decode.step(self.now_ns)
                self.status.mode, self.command.stamp_ns = mode, self.now_ns
                self.encode.step(self.now_ns)
                self.writer.write(self.sent, self.now_ns)
            self.now_ns += MS
        self.history.append((torque.tobytes(), self.joints.to_bytes()))
        return torque


class Nobody:
    """Sends nothing."""

    def write(self, record, now_ns):
        pass


def test_the_command_that_goes_in_is_the_torque_that_comes_out():
    rig, rng = Rig(), np.random.default_rng(0)
    for _ in range(30):
        rig.command.position = ANGLES + rng.uniform(-0.05, 0.05, 12)
        rig.command.velocity = rng.uniform(-2, 2, 12)
        rig.command.effort = rng.uniform(-15, 15, 12)
        rig.command.stiffness, rig.command.damping = rng.uniform(0, 60, 12), rng.uniform(0.1, 2, 12)
        rig.rates = rng.uniform(-1, 1, 12)
        for _ in range(3):
            torque = rig.tick()
        command = rig.command
        expected = command.stiffness * (command.position - rig.angles)
        expected += command.damping * (command.velocity - rig.rates) + command.effort
        # half a code of each field, and the encoder's own step
        position = 0.5 * 25 / 65535 + np.pi / 16384
        error = (
            np.abs(command.stiffness) * position
            + 0.5 * 500 / 4095 * np.abs(command.position - rig.angles)
            + command.damping * 0.5 * 60 / 4095
            + 0.5 * 5 / 4095 * np.abs(command.velocity - rig.rates)
            + 0.5 * 80 / 4095
        )
        assert (np.abs(torque - expected) <= error * 1.05 + 1e-3).all()


def test_what_the_drives_measure_comes_back_as_the_joint_state():
    rig = Rig()
    rig.rates = np.linspace(-3, 3, 12)
    rig.command.effort = np.linspace(-10, 10, 12)
    for _ in range(4):
        torque = rig.tick()
    joints = rig.joints
    np.testing.assert_allclose(joints.position, rig.angles, atol=25 / 65535 + np.pi / 16384)
    np.testing.assert_allclose(joints.velocity, rig.rates, atol=60 / 4095)
    np.testing.assert_allclose(joints.effort, torque, atol=80 / 4095)
    np.testing.assert_allclose(joints.temperature, 25.0, atol=1.0)
    assert not joints.error.any()
    assert joints.rejected == 0
    age = rig.now_ns - joints.reply_ns
    assert (age > 0).all()
    assert (age < 6 * MS).all()
    assert joints.stamp_ns == joints.reply_ns.max()


def test_directions_of_the_drives_are_applied_on_the_wire():
    rig = Rig()
    rig.command.effort = 5.0
    rig.tick()
    words = as_frames(rig.sent.data)[:12]["data"][:, 6:8].astype(int)
    codes = (words[:, 0] & 0xF) << 8 | words[:, 1]
    torques = codes * 80 / 4095 - 40
    np.testing.assert_allclose(torques, 5.0 * np.array(CONFIG.drives.direction), atol=0.02)


def test_drives_are_enabled_while_off_and_while_reset_only():
    rig = Rig()
    assert rig.drives.enabled.all() or not rig.drives.enabled.any()
    sent = {}
    for mode in Mode:
        for reset in (False, True):
            rig.operator.reset = reset
            rig.tick(mode)
            data = as_frames(rig.sent.data)[rig.sent.count - 12 : rig.sent.count]["data"]
            sent[mode, reset] = {row.tobytes() for row in data} == {ENABLE}
    enabling = {key for key, value in sent.items() if value}
    assert enabling == {(Mode.OFF, False), (Mode.OFF, True), (Mode.DAMPED, True), (Mode.STANDBY, True)}


def test_what_drives_were_told_by_a_control_that_is_gone_does_not_come_to_life_when_they_are_switched_on():
    rig = Rig()
    rig.command.stiffness, rig.command.position = 60.0, ANGLES + 0.3
    for _ in range(3):
        torque = rig.tick()
    assert (np.abs(torque) > 5.0).all()
    writer, rig.writer = rig.writer, Nobody()
    for _ in range(30):
        torque = rig.tick()
    assert not torque.any(), "they hear nothing, and let go"
    rig.writer = writer
    group = JointGroup(JOINTS, DIALECT, CONFIG.drives.command_age_max_ns)
    rig.encode = EncodeTask(group, rig.command, rig.status, rig.operator, rig.sent)
    torques = [rig.tick(Mode.OFF) for _ in range(10)]
    assert (np.abs(torques) < 0.1).all(), "no more than a step of the velocity is worth"


def test_damping_that_was_prepared_long_before_passes_the_gate_and_brakes_every_joint():
    rig = Rig()
    rig.command.effort, rig.command.stiffness = 10.0, 50.0
    rig.tick()
    rig.rates = np.linspace(-3, 3, 12)
    assert (np.abs(rig.tick()) > 1.0).any()
    last = damping_frames(JointGroup(JOINTS, DIALECT, MS), signals.CanFrames("/last", SIZES))
    rig.writer = FreshFrames(rig.writer, MS)
    rig.encode.step = lambda now_ns: rig.sent.copy_from(last)
    rig.tick()
    damping = np.array([joint.fallback_damping for joint in JOINTS])
    np.testing.assert_allclose(rig.tick(), -damping * rig.rates, atol=0.1)


def test_an_old_command_never_leaves_as_it_is():
    rig = Rig()
    rig.command.effort, rig.command.stiffness, rig.command.damping = 5.0, 50.0, 1.0
    rig.command.position = ANGLES + 0.2
    rig.tick()
    commanded = bytes(rig.sent.data[:192])
    rig.command.stamp_ns = rig.now_ns - CONFIG.drives.command_age_max_ns - 1
    rig.encode.step(rig.now_ns)
    damped = bytes(rig.sent.data[:192])
    assert damped != commanded
    assert rig.encode.state.counters[Counter.STALE_COMMAND] == 1
    rig.command.stamp_ns, rig.command.effort[0] = rig.now_ns, np.nan
    rig.encode.step(rig.now_ns)
    assert rig.encode.state.counters[Counter.NON_FINITE_COMMAND] == 1
    assert bytes(rig.sent.data[:192]) == damped
    # and what it is replaced by is damping alone
    rig.rates = np.linspace(-2.0, 2.0, 12)
    for _ in range(3):
        torque = rig.tick()
    np.testing.assert_allclose(torque, -CONFIG.drives.fallback_damping_nms_prad * rig.rates, atol=0.05)


def lively(rig, ticks=8):
    """A run in which every bit of every field matters."""
    rng = np.random.default_rng(3)
    for _ in range(ticks):
        rig.command.position = ANGLES + rng.uniform(0.1, 0.3, 12)
        rig.command.velocity = rng.uniform(1.0, 3.0, 12)
        rig.command.effort = rng.uniform(-3, 3, 12)
        rig.command.stiffness, rig.command.damping = rng.uniform(5, 20, 12), rng.uniform(0.5, 1.5, 12)
        rig.tick()
    return rig


def rejected(rig):
    return int(rig.joints.rejected) + int(rig.drives.rejections.sum())


CLEAN = lively(Rig())
BYTES = [0, 1, 2, 3, 4, *range(8, 16)]
"""Identifier, length and data; the padding between is no part of a frame on a bus."""


@settings(max_examples=150)
@given(
    st.sampled_from(End),
    st.integers(30, 70),
    st.sampled_from(BYTES),
    st.integers(1, 255),
)
def test_one_corrupted_byte_changes_the_run_or_is_counted(sender, which, index, mask):
    seen = []

    def corrupt(end, bus, arrival_ns, frame):
        if end != sender:
            return frame
        seen.append(frame)
        if len(seen) != which:
            return frame
        return frame[:index] + bytes([frame[index] ^ mask]) + frame[index + 1 :]

    rig = lively(Rig(corrupt))
    assert len(seen) >= which, "the frame was there to be corrupted"
    assert rig.history != CLEAN.history or rejected(rig) > 0


def test_the_same_run_again_is_the_same_run():
    again = lively(Rig())
    assert again.history == CLEAN.history
    assert rejected(again) == 0


@given(st.binary(min_size=16, max_size=16))
def test_any_frame_at_all_is_taken_or_counted_and_never_crashes(frame):
    rig = Rig()
    rig.tick()
    before = rig.joints.rejected
    rig.received.stamp_ns, rig.received.count = rig.now_ns, 1
    rig.received.data[:16] = np.frombuffer(frame, np.uint8)
    rig.received.arrival_ns[0] = rig.now_ns
    known = rig.joints.reply_ns.copy()
    rig.decode.step(rig.now_ns)
    taken = (rig.joints.reply_ns != known).sum()
    assert taken + (rig.joints.rejected - before) == 1
    for name in ("position", "velocity", "effort"):
        assert np.isfinite(getattr(rig.joints, name)).all()


def test_a_muted_drive_keeps_its_last_reading_and_its_age_grows():
    rig = Rig()
    for _ in range(3):
        rig.tick()
    rig.drives.mute(4)
    for _ in range(10):
        rig.tick()
    age = rig.now_ns - rig.joints.reply_ns
    assert age[4] >= 20 * MS
    assert (np.delete(age, 4) < 6 * MS).all()


@pytest.mark.parametrize("code", [1, 2, 5])
def test_an_error_code_arrives_with_its_number(code):
    rig = Rig()
    rig.drives.force_error(9, code)
    for _ in range(3):
        torque = rig.tick()
    assert rig.joints.error.tolist() == [0] * 9 + [code] + [0] * 2
    assert torque[9] == 0.0


def test_counters_survive_saving_and_restoring():
    rig = Rig()
    rig.received.stamp_ns, rig.received.count = rig.now_ns, 2
    rig.received.data[:] = 0
    rig.decode.step(rig.now_ns)
    count = int(rig.joints.rejected)
    saved = rig.decode.save()
    assert count == 2
    fresh = Rig()
    fresh.decode.restore(saved)
    fresh.decode.step(fresh.now_ns)
    assert fresh.joints.rejected == count
