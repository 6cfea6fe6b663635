# SPDX-License-Identifier: Apache-2.0
"""Joints to frames and back: gears, limits, age, and every kind of bad frame."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.can_frame import CAN_ERR_FLAG, CAN_RTR_FLAG, FRAME_WORDS, make_frames
from drivers.dialects import AK_V3, CLASSIC_6, CLASSIC_8, DAMIAO, DIALECTS, Ranges
from drivers.errors import DriverConfigError
from drivers.joint_group import LIMITED, REJECTED, Counter, JointGroup, Readings
from drivers.joints import Joint
from drivers.mit import DISABLE, ENABLE, SET_ZERO, MitCodec

RANGES = Ranges((-12.5, 12.5), (-65.0, 65.0), (-40.0, 40.0), (0.0, 500.0), (0.0, 5.0))
MAX_AGE_NS = 20_000_000
MASTER = 0x70


def joint(index, **changes):
    return Joint(f"joint_{index}", index // 3, index % 3 + 1, MASTER, RANGES, **changes)


def group(dialect=CLASSIC_8, count=12, **changes):
    return JointGroup([joint(index, **changes) for index in range(count)], dialect, MAX_AGE_NS)


def encode(joints, now_ns=0, stamp_ns=0, **values):
    count = len(joints.joints)
    names = ("position", "velocity", "effort", "stiffness", "damping")
    columns = [np.full(count, values.get(name, 0.0)) for name in names]
    return joints.encode(*columns, stamp_ns, now_ns)


def at_drive(joints):
    """What the drives read from the frames."""
    codec = MitCodec(joints.dialect, [j.ranges for j in joints.joints])
    return dict(
        zip(
            ("position", "velocity", "effort", "stiffness", "damping"),
            codec.decode_commands(joints.frames.view(FRAME_WORDS)["word"]).copy(),
            strict=True,
        )
    )


def replies(joints, position=0.0, velocity=0.0, effort=0.0, temperature=40.0, error=0):
    """Replies of all drives, values at the drives' outputs."""
    dialect, count = joints.dialect, len(joints.joints)
    codec = MitCodec(dialect, [j.ranges for j in joints.joints])
    frames = make_frames([dialect.reply_id(j.drive_id, j.master_id) for j in joints.joints], dialect.reply_length)
    values = np.zeros((len(codec.replies.rows), count))
    given_values = {"position": position, "velocity": velocity, "effort": effort, "error": error}
    given_values |= {"temperature": temperature, "driver_temperature": 30.0}
    for name, value in given_values.items():
        if name in codec.replies.rows:
            values[codec.replies.rows[name]] = value
    values[codec.replies.rows["id"]] = [j.drive_id for j in joints.joints]
    codec.encode_replies(values, frames.view(FRAME_WORDS)["word"])
    return frames


def decode(joints, frames, readings, rows=slice(None), arrival=100):
    chosen = frames[rows]
    arrival_ns = np.full(len(chosen), arrival, np.int64)
    return joints.decode(chosen, joints.bus[rows], arrival_ns, len(chosen), readings)


def test_frames_carry_the_dialects_identifiers():
    assert encode(group(CLASSIC_8))["can_id"].tolist() == [1, 2, 3] * 4
    assert encode(group(AK_V3))["can_id"].tolist() == [0x80000801, 0x80000802, 0x80000803] * 4
    assert group().bus.tolist() == [0] * 3 + [1] * 3 + [2] * 3 + [3] * 3
    assert replies(group(AK_V3))["can_id"][0] == 0x80002901


def test_enabling_never_sets_the_zero():
    joints = group()
    for frames, data in (
        (joints.enable_frames(), ENABLE),
        (joints.disable_frames(), DISABLE),
        (joints.set_zero_frames(), SET_ZERO),
    ):
        assert {frame.tobytes() for frame in frames["data"]} == {data}
        assert frames["can_id"].tolist() == joints.frames["can_id"].tolist()


@given(
    direction=st.sampled_from((-1, 1)),
    gear=st.floats(0.3, 3.0),
    offset=st.floats(-1.0, 1.0),
    speed=st.floats(-2.0, 2.0),
    effort=st.floats(-10.0, 10.0),
)
def test_gear_and_direction_conserve_power_and_impedance(direction, gear, offset, speed, effort):
    joints = group(count=1, direction=direction, gear_ratio=gear, offset=offset, position_limits=(-2, 2))
    stiffness, damping, wanted, actual = 20.0, 0.4, 0.5, 0.2
    encode(joints, position=wanted, velocity=speed, effort=effort, stiffness=stiffness, damping=damping)
    drive = {name: value[0] for name, value in at_drive(joints).items()}
    multiplier = direction * gear
    assert drive["velocity"] * drive["effort"] == pytest.approx(speed * effort, abs=0.4 + 0.02 * abs(effort))
    motor_error = drive["position"] - multiplier * (actual - offset)
    joint_torque = multiplier * drive["stiffness"] * motor_error
    assert joint_torque == pytest.approx(stiffness * (wanted - actual), abs=0.06 * gear**2 + 0.2)
    assert multiplier**2 * drive["damping"] == pytest.approx(damping, abs=0.001 * gear**2)


@pytest.mark.parametrize("name", sorted(DIALECTS))
def test_measurements_come_back_in_joint_coordinates(name):
    joints = JointGroup(
        [joint(i, direction=(-1) ** i, gear_ratio=1 + 0.1 * i, offset=0.05 * i) for i in range(12)], DIALECTS[name], 1
    )
    readings = Readings.empty(12)
    assert decode(joints, replies(joints, 1.0, 2.0, 3.0), readings) == 12
    multiplier = np.array([j.multiplier for j in joints.joints])
    np.testing.assert_allclose(readings.position, 1.0 / multiplier + 0.05 * np.arange(12), atol=2e-4)
    np.testing.assert_allclose(readings.velocity, 2.0 / multiplier, atol=0.02)
    np.testing.assert_allclose(readings.effort, 3.0 * multiplier, atol=0.03)
    assert readings.reply_ns.tolist() == [100] * 12
    assert np.isnan(readings.temperature).all() == name.startswith(("classic-6", "classic-7"))
    assert not joints.counters.any()


def test_the_hotter_temperature_counts_and_health_is_no_error():
    joints, readings = group(DAMIAO), Readings.empty(12)
    decode(joints, replies(joints, temperature=25.0, error=1), readings)
    assert readings.temperature.tolist() == [30.0] * 12
    assert readings.error.tolist() == [0] * 12
    decode(joints, replies(joints, error=0xB), readings)
    assert readings.error.tolist() == [0xB] * 12


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_positions_are_unwrapped(seed):
    joints, readings = group(count=3, direction=-1, gear_ratio=2.0, offset=0.3), Readings.empty(3)
    steps = np.random.default_rng(seed).uniform(-5.5, 5.5, 40)
    truth = 0.1
    for step in np.concatenate([[0.0], steps]):
        truth += step
        motor = -2.0 * (truth - 0.3)
        wrapped = (motor + 12.5) % 25.0 - 12.5
        decode(joints, replies(joints, wrapped), readings)
        np.testing.assert_allclose(readings.position, truth, atol=2e-4)


def test_limits_clip_and_count():
    joints = group(position_limits=(-1.0, 1.5), velocity_limit=20.0, effort_limit=30.0)
    encode(joints, position=1.5, velocity=-20.0, effort=30.0)
    assert not joints.counters.any()
    encode(joints, position=-3.0, velocity=21.0, effort=-31.0, stiffness=501.0, damping=-0.1)
    assert joints.counters[LIMITED].tolist() == [12] * 5
    drive = at_drive(joints)
    np.testing.assert_allclose(drive["position"], -1.0, atol=2e-4)
    np.testing.assert_allclose(drive["velocity"], 20.0, atol=0.02)
    np.testing.assert_allclose(drive["effort"], -30.0, atol=0.02)


def test_a_continuous_joint_gets_no_stiffness():
    joints = group()
    encode(joints, position=1e9, stiffness=50.0, damping=1.0)
    assert at_drive(joints)["stiffness"].tolist() == [0.0] * 12
    assert joints.counters[LIMITED].tolist() == [0, 0, 0, 12, 0]


@pytest.mark.parametrize(("age_ns", "stale"), [(0, False), (MAX_AGE_NS, False), (MAX_AGE_NS + 1, True), (-1, True)])
def test_an_old_command_becomes_damping(age_ns, stale):
    joints = group(position_limits=(-1.0, 1.0), fallback_damping=2.0)
    encode(joints, now_ns=10**9, stamp_ns=10**9 - age_ns, position=0.5, effort=5.0, stiffness=50.0, damping=1.0)
    drive = at_drive(joints)
    assert joints.counters[Counter.STALE_COMMAND] == stale
    np.testing.assert_allclose(drive["damping"], 2.0 if stale else 1.0, atol=1e-3)
    np.testing.assert_allclose(drive["stiffness"], 0.0 if stale else 50.0, atol=0.07)
    np.testing.assert_allclose(drive["effort"], 0.0 if stale else 5.0, atol=0.02)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["position", "velocity", "effort", "stiffness", "damping"])
def test_a_command_that_is_not_finite_becomes_damping(name, bad):
    joints = group(position_limits=(-1.0, 1.0), fallback_damping=2.0)
    encode(joints, **{"stiffness": 50.0, name: bad})
    assert joints.counters[Counter.NON_FINITE_COMMAND] == 1
    assert at_drive(joints)["stiffness"].tolist() == [0.0] * 12


@pytest.mark.parametrize(
    ("spoil", "counter"),
    [
        (lambda frame: frame.__setitem__("length", 7), Counter.WRONG_LENGTH),
        (lambda frame: frame.__setitem__("can_id", 0x71), Counter.UNKNOWN_ID),
        (lambda frame: frame["data"].__setitem__(0, 9), Counter.UNKNOWN_ID),
        (lambda frame: frame.__setitem__("can_id", MASTER | CAN_ERR_FLAG), Counter.ERROR_FRAME),
        (lambda frame: frame.__setitem__("can_id", MASTER | CAN_RTR_FLAG), Counter.REMOTE_FRAME),
    ],
)
def test_a_bad_frame_is_counted_and_changes_nothing_else(spoil, counter):
    joints, readings = group(), Readings.empty(12)
    decode(joints, replies(joints, 1.0), readings, arrival=100)
    frames = replies(joints, 2.0)
    spoil(frames[4])
    assert decode(joints, frames, readings, arrival=200) == 11
    expected = [0] * len(Counter)
    expected[counter] = 1
    assert joints.counters.tolist() == expected
    assert readings.reply_ns.tolist() == [200] * 4 + [100] + [200] * 7
    assert readings.position[4] == pytest.approx(1.0, abs=2e-4)
    assert readings.position[5] == pytest.approx(2.0, abs=2e-4)
    decode(joints, frames, readings)
    assert joints.counters[REJECTED].sum() == 2


def test_an_implausible_value_is_rejected():
    joints, readings = group(plausible_position=(-2.0, 2.0), plausible_velocity=50.0), Readings.empty(12)
    velocity = np.zeros(12)
    velocity[3] = 60.0
    decode(joints, replies(joints, 1.0, velocity), readings)
    assert joints.counters[Counter.OUT_OF_RANGE] == 1
    assert readings.reply_ns[3] == 0
    assert (np.delete(readings.reply_ns, 3) == 100).all()


def test_of_two_replies_the_last_counts_and_order_does_not_matter():
    joints, readings = group(CLASSIC_6), Readings.empty(12)
    position = 0.1 * np.arange(12)
    rows = np.array([5, 3, 3, 0, 11])
    frames = replies(joints, position)
    frames[3] = replies(joints, 0.9)[3]
    decode(joints, frames, readings, rows)
    np.testing.assert_allclose(readings.position[[5, 3, 0, 11]], [0.5, 0.9, 0.0, 1.1], atol=2e-4)
    assert (readings.reply_ns != 0).tolist() == [index in rows for index in range(12)]


@given(st.lists(st.binary(min_size=16, max_size=16), min_size=1, max_size=24), st.integers(0, 255))
def test_any_bytes_are_taken_or_counted(raw, bus):
    joints, readings = group(), Readings.empty(12)
    frames = np.frombuffer(b"".join(raw), joints.frames.dtype)
    count = len(raw)
    taken = joints.decode(frames, np.full(count, bus, np.uint8), np.ones(count, np.int64), count, readings)
    assert taken + joints.counters[REJECTED].sum() == count


@given(st.integers(0, 11), st.integers(0, 15), st.integers(1, 255))
def test_a_corrupted_byte_changes_the_values_or_is_counted(row, byte, flip):
    joints, clean, dirty = group(), Readings.empty(12), Readings.empty(12)
    frames = replies(joints, 1.0, 1.0, 1.0)
    decode(joints, frames, clean)
    frames.view(np.uint8)[16 * row + byte] ^= flip
    decode(joints, frames, dirty)
    unused = 5 <= byte <= 7
    pairs = [(getattr(clean, f.name), getattr(dirty, f.name)) for f in dataclasses.fields(clean)]
    same = all(np.array_equal(one, other, equal_nan=True) for one, other in pairs)
    assert unused or not same or joints.counters[REJECTED].sum() == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"direction": 0}, "joint_0: direction = 0"),
        ({"gear_ratio": math.nan}, "gear_ratio = nan"),
        ({"effort_limit": 41.0}, r"effort_limit needs 41 N.m at the drive, whose range is -40 to 40"),
        ({"velocity_limit": 40.0, "gear_ratio": 2.0}, "velocity_limit needs 80 rad/s"),
        ({"position_limits": (-13.0, 0.0)}, "position_limits needs -13 rad"),
        ({"position_limits": (1.0, 0.0)}, "not an increasing pair"),
        ({"fallback_damping": 6.0}, "fallback_damping needs 6"),
    ],
)
def test_a_contradictory_joint_is_refused(changes, message):
    with pytest.raises(DriverConfigError, match=message):
        joint(0, **changes)


def test_two_drives_on_one_address_are_refused():
    with pytest.raises(DriverConfigError, match="joint_0 and joint_0 share id 0x70 on bus 0 with 0x1"):
        JointGroup([joint(0), joint(0)], CLASSIC_8, 1)


def test_replies_that_a_drive_would_take_for_commands_are_refused():
    listening = dataclasses.replace(joint(1), master_id=1)
    with pytest.raises(
        DriverConfigError, match="joint joint_1: replies go to id 0x1 on bus 0, where the drive of joint_0"
    ):
        JointGroup([joint(0), listening], CLASSIC_8, 1)


def test_state_may_live_in_the_callers_arrays():
    counters = np.zeros(len(Counter), np.uint32)
    joints = JointGroup([joint(0)], CLASSIC_8, 1, counters)
    encode(joints, now_ns=5)
    assert counters[Counter.STALE_COMMAND] == 1
