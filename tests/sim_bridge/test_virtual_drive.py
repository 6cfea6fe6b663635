# SPDX-License-Identifier: Apache-2.0
"""Virtual drives obey and answer as drives do: through frames alone."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.addressing import Rejection
from drivers.can_frame import FRAME_WORDS
from drivers.dialects import CLASSIC_7, CLASSIC_8, DAMIAO, DIALECTS, Ranges
from drivers.errors import DriverConfigError
from drivers.joint_group import REJECTED, JointGroup, Readings
from drivers.joints import Joint
from drivers.memory_bus import End, MemoryBus
from sim_bridge.drive_model import DriveModel, available_torque
from sim_bridge.virtual_drive import VirtualDrives

RANGES = Ranges((-12.5, 12.5), (-65.0, 65.0), (-40.0, 40.0), (0.0, 500.0), (0.0, 5.0))
MODEL = DriveModel(
    peak_torque=33.0,
    no_load_speed=25.0,
    encoder_counts=65536,
    velocity_noise=0.0,
    command_timeout_ns=25_000_000,
    timeout_damping=1.5,
    ambient_temperature=25.0,
    heating=0.01,
    cooling_time=100.0,
    temperature_limit=90.0,
    bus_voltage=48.0,
)
MS = 1_000_000


class Rig:
    """A joint group and its drives, wired directly."""

    def __init__(self, dialect=CLASSIC_8, count=12, model=MODEL, seed=0, **changes):
        limits = {"position_limits": (-3.0, 3.0), **changes}
        self.joints = [
            Joint(f"joint_{i}", i // 3, i % 3 + 1, 0x70, RANGES, direction=(-1) ** i, offset=0.1 * i, **limits)
            for i in range(count)
        ]
        self.count = count
        self.group = JointGroup(self.joints, dialect, 10**12)
        self.drives = VirtualDrives(self.joints, dialect, model, seed)
        self.readings = Readings.empty(count)
        self.at(0.0)
        self.send(self.group.enable_frames(), 0)

    def at(self, position, velocity=0.0, now_ns=0):
        return self.drives.torque(np.full(self.count, position), np.full(self.count, velocity), now_ns)

    def send(self, frames, now_ns):
        times = np.full(len(frames), now_ns, np.int64)
        replies, bus, sent_ns = self.drives.answer(frames, self.group.bus[: len(frames)], times)
        return self.group.decode(replies, bus, sent_ns, len(replies), self.readings)

    def command(self, now_ns=0, position=0.0, velocity=0.0, effort=0.0, stiffness=0.0, damping=0.0):
        columns = (np.full(self.count, v) for v in (position, velocity, effort, stiffness, damping))
        return self.send(self.group.encode(*columns, now_ns, now_ns), now_ns)


def test_the_pd_law_holds_at_the_joint_whatever_the_direction_offset_and_gear():
    for gear in (1.0, 1.6):
        rig = Rig(gear_ratio=gear)
        rig.command(position=0.5, velocity=1.0, effort=2.0, stiffness=40.0, damping=1.0)
        expected = 40.0 * (0.5 - 0.2) + 1.0 * (1.0 - 0.4) + 2.0
        np.testing.assert_allclose(rig.at(0.2, 0.4), expected, atol=0.15)


@pytest.mark.parametrize("name", sorted(DIALECTS))
def test_every_command_is_answered_with_what_the_drive_measures(name):
    rig = Rig(DIALECTS[name])
    rig.command(effort=3.0)
    rig.at(0.3, -0.7)
    assert rig.command(effort=3.0, now_ns=MS) == 12
    np.testing.assert_allclose(rig.readings.position, 0.3, atol=3e-4)
    np.testing.assert_allclose(rig.readings.velocity, -0.7, atol=0.02)
    np.testing.assert_allclose(rig.readings.effort, 3.0, atol=0.03)
    assert rig.readings.reply_ns.tolist() == [MS] * 12
    assert not rig.readings.error.any()
    assert not rig.group.counters.any()


def test_the_encoder_is_quantised_and_the_velocity_noisy_but_seeded():
    model = dataclasses.replace(MODEL, encoder_counts=256, velocity_noise=0.5)
    runs = []
    for seed in (1, 1, 2):
        rig = Rig(model=model, seed=seed)
        torques = []
        for tick in range(1, 1200):
            rig.command(tick * MS, position=0.5, stiffness=20.0, damping=1.0)
            torques.append(rig.at(0.2, 0.0, tick * MS).copy())
        runs.append(np.array(torques))
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    assert runs[0].std() == pytest.approx(0.5, rel=0.1)
    turn = 2 * np.pi / 256
    offset = 0.1 * np.arange(12)
    seen = np.rint((0.2 - offset) / turn) * turn + offset
    np.testing.assert_allclose(runs[0].mean(axis=0), 20.0 * (0.5 - seen), atol=0.1)


@pytest.mark.parametrize(
    ("velocity", "sense", "expected"),
    [
        (0.0, 1, 33.0),
        (12.5, 1, 16.5),
        (25.0, 1, 0.0),
        (30.0, 1, 0.0),
        (-12.5, 1, 33.0),
        (-12.5, -1, -16.5),
        (30.0, -1, -33.0),
    ],
)
def test_torque_falls_to_zero_at_no_load_speed_in_the_sense_of_motion_only(velocity, sense, expected):
    rig = Rig()
    rig.command(effort=sense * 39.0)
    np.testing.assert_allclose(rig.at(0.0, velocity), expected, atol=1e-9)


def test_without_commands_a_drive_falls_back_to_damping_and_recovers():
    rig = Rig()
    rig.command(position=0.5, effort=1.0, stiffness=40.0)
    assert (rig.at(0.0, 1.0, 25 * MS) > 15).all()
    np.testing.assert_allclose(rig.at(0.0, 1.0, 25 * MS + 1), -1.5, atol=1e-9)
    np.testing.assert_allclose(rig.at(0.0, -2.0, 40 * MS), 3.0, atol=1e-9)
    rig.command(41 * MS, effort=1.0)
    np.testing.assert_allclose(rig.at(0.0, 1.0, 42 * MS), 1.0, atol=0.02)


def test_one_drive_times_out_alone():
    rig = Rig()
    rig.command(effort=2.0)
    frames = rig.group.frames.copy()
    rig.send(frames[:11], 20 * MS)
    torque = rig.at(0.0, 1.0, 30 * MS)
    np.testing.assert_allclose(torque[:11], 2.0, atol=0.02)
    assert torque[11] == pytest.approx(-1.5)


def test_drives_idle_until_enabled_and_after_disabling_but_answer():
    rig = Rig()
    rig.send(rig.group.disable_frames(), MS)
    assert rig.command(2 * MS, effort=5.0) == 12
    assert not rig.at(0.1, 0.0, 2 * MS).any()
    rig.send(rig.group.enable_frames(), 3 * MS)
    assert not rig.at(0.1, 0.0, 3 * MS).any(), "the command from before must not come back"
    rig.command(4 * MS, effort=5.0)
    np.testing.assert_allclose(rig.at(0.1, 0.0, 4 * MS), 5.0, atol=0.02)


def test_commands_that_arrive_in_parts_work_like_one_batch():
    whole, parts = Rig(), Rig()
    for tick in range(1, 5):
        whole.command(tick * MS, position=0.1 * tick, effort=1.0, stiffness=20.0, damping=1.0)
        frames = whole.group.frames
        for rows in (slice(0, None, 3), slice(1, None, 3), slice(2, None, 3)):
            times = np.full(4, tick * MS, np.int64)
            parts.drives.answer(frames[rows], parts.group.bus[rows], times)
        expected = whole.at(0.1, 0.5, tick * MS)
        np.testing.assert_array_equal(parts.at(0.1, 0.5, tick * MS), expected)


def test_setting_zero_moves_the_zero_and_nothing_else():
    rig = Rig()
    rig.at(0.7)
    rig.send(rig.group.set_zero_frames(), MS)
    rig.at(0.7)
    rig.command(2 * MS)
    np.testing.assert_allclose(rig.readings.position, 0.1 * np.arange(12), atol=3e-4)


def test_a_muted_drive_obeys_but_does_not_answer():
    rig = Rig()
    rig.drives.mute(4)
    assert rig.command(MS, effort=2.0) == 11
    assert rig.readings.reply_ns.tolist() == [MS] * 4 + [0] + [MS] * 7
    np.testing.assert_allclose(rig.at(0.0), 2.0, atol=0.02)
    rig.drives.mute(4, False)
    assert rig.command(2 * MS) == 12


@pytest.mark.parametrize(("dialect", "code"), [(CLASSIC_8, 2), (DAMIAO, 0xA)])
def test_a_forced_error_is_reported_stops_the_drive_and_is_cleared_by_enabling(dialect, code):
    rig = Rig(dialect)
    rig.drives.force_error(7, code)
    rig.command(MS, effort=2.0)
    assert rig.readings.error.tolist() == [0] * 7 + [code] + [0] * 4
    assert rig.at(0.0)[7] == 0.0
    rig.drives.force_error(7, 0)
    rig.command(2 * MS, effort=2.0)
    assert rig.readings.error[7] == code
    rig.send(rig.group.enable_frames(), 3 * MS)
    rig.command(4 * MS, effort=2.0)
    assert not rig.readings.error.any()
    assert rig.at(0.0)[7] == pytest.approx(2.0, abs=0.02)


def test_a_motor_heats_with_the_square_of_torque_cools_and_trips():
    rig = Rig()
    for second in range(100):
        rig.command(second * 1000 * MS, effort=10.0)
        rig.at(0.0, 0.0, second * 1000 * MS)
    # T - ambient = heating tau^2 cooling_time (1 - e^(-t / cooling_time)), with the 1 s steps of explicit Euler
    expected = 25.0 + 0.01 * 10.0**2 * 100.0 * (1 - 0.99**99)
    np.testing.assert_allclose(rig.drives.temperature, expected, rtol=5e-3)
    assert rig.readings.temperature[0] == pytest.approx(rig.drives.temperature[0], abs=1.5)
    second = 100
    while not rig.readings.error.any() and second < 400:
        rig.command(second * 1000 * MS, effort=10.0)
        rig.at(0.0, 0.0, second * 1000 * MS)
        second += 1
    assert rig.readings.error.tolist() == [1] * 12
    assert rig.drives.temperature.max() < 93.0
    for later in range(second, second + 60):
        assert not rig.at(0.0, 0.0, later * 1000 * MS).any()
    assert rig.drives.temperature.max() < 70.0


def test_a_batch_with_bad_frames_is_counted_and_the_rest_obeyed():
    rig = Rig()
    frames = rig.group.encode(*np.zeros((2, 12)), np.full(12, 2.0), *np.zeros((2, 12)), 0, 0).copy()
    frames["length"][0] = 7
    frames["can_id"][1] = 0x55
    frames["can_id"][2] |= 0x2000_0000
    frames["can_id"][3] |= 0x4000_0000
    assert rig.send(frames, MS) == 8
    expected = [0] * len(Rejection)
    for kind in (Rejection.WRONG_LENGTH, Rejection.UNKNOWN_ID, Rejection.ERROR_FRAME, Rejection.REMOTE_FRAME):
        expected[kind] = 1
    assert rig.drives.rejections.tolist() == expected
    np.testing.assert_allclose(rig.at(0.0), [0.0] * 4 + [2.0] * 8, atol=0.02)


def test_positions_wrap_at_the_ends_of_the_drives_range():
    rig = Rig(position_limits=(-float("inf"), float("inf")), count=1)
    for position in np.arange(0.0, 40.0, 2.0):
        rig.at(position)
        rig.command(now_ns=1)
        assert rig.readings.position[0] == pytest.approx(position, abs=5e-4)
    assert rig.drives.clipped_replies == 0


def run_over_the_bus(tamper=None):
    """A tenth of a second of twelve inertias held by their drives; what the controller saw, and all rejections."""
    rig, bus = Rig(), MemoryBus(4, tamper=tamper)
    position, velocity, seen = np.zeros(12), np.zeros(12), []
    for tick in range(50):
        now_ns = tick * 2 * MS
        wanted = np.full(12, 0.3) - 0.1 * rig.readings.position
        frames = rig.group.encode(wanted, *np.zeros((2, 12)), np.full(12, 30.0), np.ones(12), now_ns, now_ns)
        bus.send(End.HOST, rig.group.bus, frames, now_ns)
        for step in (1, 2):
            until_ns = now_ns + step * MS
            replies = rig.drives.answer(*bus.receive(End.DEVICE, until_ns))
            bus.send(End.DEVICE, replies[1], replies[0], replies[2])
            velocity += 1e-3 * rig.drives.torque(position, velocity, until_ns) / 0.05
            position += 1e-3 * velocity
        received = bus.receive(End.HOST, now_ns + 2 * MS)
        rig.group.decode(*received, len(received.bus), rig.readings)
        seen += [rig.readings.position.copy(), rig.readings.velocity.copy(), rig.readings.effort.copy()]
    rejected = int(rig.group.counters[REJECTED].sum() + rig.drives.rejections.sum())
    return np.array(seen), rejected


def test_the_loop_closes_over_the_bus_and_is_reproducible():
    seen, rejected = run_over_the_bus()
    again, _ = run_over_the_bus()
    np.testing.assert_array_equal(seen, again)
    assert rejected == 0
    assert (seen[-3] > 0.2).all()


@pytest.mark.parametrize("sender", list(End))
@pytest.mark.parametrize("byte", [0, 1, 2, 3, 4, 8, 9, 10, 11, 12, 13])
def test_one_corrupted_byte_on_the_bus_changes_the_run_or_is_counted(sender, byte):
    passed = []

    def tamper(end, wire, arrival_ns, frame):
        if end == sender:
            passed.append(arrival_ns)
            if len(passed) == 200:
                return frame[:byte] + bytes([frame[byte] ^ 0x80]) + frame[byte + 1 :]
        return frame

    seen, rejected = run_over_the_bus(tamper)
    clean, _ = run_over_the_bus()
    assert len(passed) > 200
    assert rejected == 1 or not np.array_equal(seen, clean)


def test_voltage_is_reported_where_the_dialect_has_it():
    rig = Rig(CLASSIC_7)
    frames = rig.group.enable_frames()
    replies, _, _ = rig.drives.answer(frames, rig.group.bus, np.zeros(12, np.int64))
    assert replies.view(FRAME_WORDS)["word"][0] >> 8 & 0xFF == 48


@given(st.floats(-40, 40), st.floats(-30, 30))
def test_torque_is_limited_in_the_sense_of_motion(torque, velocity):
    upper = np.clip(33.0 * (1 - velocity / 25.0), 0.0, 33.0)
    lower = np.clip(33.0 * (-1 - velocity / 25.0), -33.0, 0.0)
    assert available_torque(torque, velocity, 33.0, 33.0 / 25.0) == pytest.approx(np.clip(torque, lower, upper))


def test_a_contradictory_model_is_refused():
    with pytest.raises(DriverConfigError, match="no_load_speed = 0"):
        dataclasses.replace(MODEL, no_load_speed=0.0)
    with pytest.raises(DriverConfigError, match="12 joints need as many drive models, not 2"):
        VirtualDrives(Rig().joints, CLASSIC_8, [MODEL, MODEL], 0)
