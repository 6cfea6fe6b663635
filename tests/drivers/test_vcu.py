# SPDX-License-Identifier: Apache-2.0
"""A vehicle's control unit: frames as its DBC lays them out, every bad frame counted, and every bad DBC refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.can_frame import CAN_EFF_FLAG, CAN_ERR_FLAG, CAN_FRAME, CAN_RTR_FLAG
from drivers.errors import DriverConfigError
from drivers.guarded_frames import Flaw, GuardedReceiver
from drivers.vcu import (
    COMMAND_FRAMES,
    FLAWS,
    STATE_FRAMES,
    Counter,
    UnitCommandMode,
    UnitReadings,
    VehicleUnit,
)
from drivers.vcu_database import OWN_DBC, STATES, UnitDatabase

MAX_AGE_NS = 20_000_000
ANGLES, SPEEDS = np.array([0.1, -0.2, 0.3, 1.57]), np.array([1.0, 2.0, 3.0, -4.0])
DATABASE = UnitDatabase()


def unit(dbc=OWN_DBC):
    return VehicleUnit(MAX_AGE_NS, dbc)


def encode(vehicle, steering=ANGLES, speed=SPEEDS, mode=UnitCommandMode.DRIVE, enable=True, stamp_ns=0, now_ns=0):
    return vehicle.encode(mode, enable, np.array(steering, float), np.array(speed, float), stamp_ns, now_ns)


def at_unit(frames, database=DATABASE):
    """What the unit takes from command frames, by message."""
    receiver, count = GuardedReceiver(database.commands, 0), len(frames)
    flaws, alive = np.zeros(len(Flaw), np.uint32), np.zeros(COMMAND_FRAMES, np.uint32)
    found = list(receiver.accepted(frames, np.zeros(count, np.uint8), np.zeros(count, np.int64), alive, flaws))
    assert not flaws.any()
    return [accepted.values for accepted in found]


def states(alive=0, database=DATABASE, **changed):
    """One state frame of each kind."""
    frames = np.zeros(STATE_FRAMES, CAN_FRAME)
    for row, message in enumerate(database.states):
        values = {name: max(0.0, bounds.low) for name, bounds in message.ranges.items()} | changed
        data = message.encode(values, alive)
        frames[row] = message.can_id, message.length, 0, np.frombuffer(data.ljust(8, b"\0"), np.uint8)
    return frames


def decode(vehicle, frames, readings, bus=0, arrival_ns=7):
    count = len(frames)
    wires, times = np.full(count, bus, np.uint8), np.full(count, arrival_ns, np.int64)
    return vehicle.decode(frames, wires, times, count, readings)


def test_command_frames_are_these_bytes():
    frames = encode(unit())
    assert [(hex(f["can_id"]), f["data"].tobytes()[: f["length"]].hex()) for f in frames] == [
        ("0x100", "9590"),
        ("0x101", "c100e803e803"),
        ("0x102", "f40030f8d007"),
        ("0x103", "4600b80bb80b"),
        ("0x104", "e000543d60f0"),
    ]


@given(
    st.lists(st.floats(-1.65, 1.65), min_size=4, max_size=4),
    st.lists(st.floats(-32.0, 32.0), min_size=4, max_size=4),
    st.sampled_from(UnitCommandMode),
    st.booleans(),
)
def test_commands_come_back_within_half_a_resolution(steering, speed, mode, enable):
    head, *wheels = at_unit(encode(unit(), steering, speed, mode, enable))
    assert (head["ModeCommand"], head["EnableCommand"]) == (mode, enable)
    np.testing.assert_allclose([w["SteeringCommand"] for w in wheels], steering, atol=0.5e-4 + 1e-9)
    np.testing.assert_allclose([w["SpeedCommand"] for w in wheels], speed, atol=0.5e-3 + 1e-9)


@given(st.sampled_from(range(STATE_FRAMES)), st.data())
def test_states_come_back_within_half_a_resolution(kind, draw):
    message = DATABASE.states[kind]
    values = {
        name: draw.draw(st.integers(0, int(r.high)) if r.resolution == 1.0 and r.low == 0 else st.floats(r.low, r.high))
        for name, r in message.ranges.items()
    }
    data = message.encode(values, 3)
    found = message.decode(data)
    assert message.intact(data)
    assert message.plausible(found)
    assert found["AliveCounter"] == 3
    for name, bounds in message.ranges.items():
        assert abs(found[name] - values[name]) <= 0.5 * bounds.resolution + 1e-9


def test_readings_hold_what_the_frames_say():
    vehicle, readings = unit(), UnitReadings.empty()
    assert np.isnan(readings.temperature).all()
    frames = states(
        SteeringAngle=-0.5,
        WheelSpeed=2.0,
        MotorCurrent=-3.0,
        DriveFault=1,
        SteeringFault=3,
        UnitMode=2,
        UnitEnabled=1,
        BatteryVoltage=50.5,
        BatteryCurrent=4.0,
        BatteryCharge=0.75,
        **{name: 61 for name in STATES["MotorTemperatures"]},
    )
    assert decode(vehicle, frames, readings) == STATE_FRAMES
    np.testing.assert_allclose(readings.steering, -0.5)
    np.testing.assert_allclose(readings.speed, 2.0)
    np.testing.assert_allclose(readings.current, -3.0)
    np.testing.assert_allclose(readings.temperature, 61.0)
    np.testing.assert_allclose(readings.battery, (50.5, 4.0, 0.75))
    assert readings.fault.tolist() == [3] * 4 + [1] * 4
    assert (readings.mode, readings.enabled) == (2, True)
    assert readings.reply_ns.tolist() == [7] * STATE_FRAMES
    assert not vehicle.counters.any()


def test_the_alive_counter_goes_round_in_all_frames_of_a_set():
    vehicle = unit()
    for count in range(40):
        assert {values["AliveCounter"] for values in at_unit(encode(vehicle))} == {count % 16}
    assert vehicle.counters[Counter.SENT] == 40


@pytest.mark.parametrize(
    ("change", "counter"),
    [
        ({"stamp_ns": 0, "now_ns": MAX_AGE_NS + 1}, Counter.STALE_COMMAND),
        ({"stamp_ns": 1, "now_ns": 0}, Counter.STALE_COMMAND),
        ({"steering": [0, np.nan, 0, 0]}, Counter.NON_FINITE_COMMAND),
        ({"speed": [0, 0, 0, np.inf]}, Counter.NON_FINITE_COMMAND),
    ],
)
def test_commands_that_must_not_be_sent_brake(change, counter):
    vehicle = unit()
    head, *wheels = at_unit(encode(vehicle, **change))
    assert (head["ModeCommand"], head["EnableCommand"]) == (UnitCommandMode.BRAKE, 1)
    assert not any(values["SpeedCommand"] for values in wheels)
    assert vehicle.counters[counter] == 1


def test_values_beyond_the_range_are_clipped_and_counted():
    vehicle = unit()
    _, first, *_ = at_unit(encode(vehicle, [3.0, 0, 0, -2.0], [0, 99.0, 0, 0]))
    assert first["SteeringCommand"] == pytest.approx(1.65)
    assert vehicle.counters[Counter.LIMITED_STEERING] == 2
    assert vehicle.counters[Counter.LIMITED_SPEED] == 1


def flipped(frames):
    frames["data"][0, 3] ^= 1


def shortened(frames):
    frames["length"][0] -= 1


def flagged(flag):
    def change(frames):
        frames["can_id"][0] |= flag

    return change


def moved(frames):
    """The bytes of one wheel under the identifier of another: the checksum covers it."""
    frames["can_id"][0] = frames["can_id"][1]


@pytest.mark.parametrize(
    ("change", "counter"),
    [
        (flipped, Counter.CHECKSUM),
        (moved, Counter.CHECKSUM),
        (shortened, Counter.WRONG_LENGTH),
        (flagged(CAN_ERR_FLAG), Counter.ERROR_FRAME),
        (flagged(CAN_RTR_FLAG), Counter.REMOTE_FRAME),
        (flagged(CAN_EFF_FLAG), Counter.UNKNOWN_ID),
    ],
)
def test_bad_frames_are_refused_and_counted(change, counter):
    vehicle, readings, frames = unit(), UnitReadings.empty(), states(WheelSpeed=5.0)
    change(frames)
    assert decode(vehicle, frames, readings) == STATE_FRAMES - 1
    assert readings.speed[0] == 0.0
    assert readings.reply_ns[0] == 0
    assert vehicle.counters[counter] == vehicle.counters.sum() == 1


def test_a_frame_that_is_repeated_is_refused_and_a_gap_is_counted():
    vehicle, readings = unit(), UnitReadings.empty()
    decode(vehicle, states(15), readings, arrival_ns=1)
    assert decode(vehicle, states(15), readings, arrival_ns=2) == 0
    assert vehicle.counters[Counter.STALLED] == STATE_FRAMES
    assert readings.reply_ns.tolist() == [1] * STATE_FRAMES
    assert decode(vehicle, states(0), readings, arrival_ns=3) == STATE_FRAMES
    assert vehicle.counters[Counter.MISSED] == 0
    assert decode(vehicle, states(3), readings, arrival_ns=4) == STATE_FRAMES
    assert vehicle.counters[Counter.MISSED] == 2 * STATE_FRAMES


def test_frames_of_another_bus_are_not_the_units():
    vehicle = unit()
    assert decode(vehicle, states(), UnitReadings.empty(), bus=1) == 0
    assert vehicle.counters[Counter.UNKNOWN_ID] == STATE_FRAMES


def altered(tmp_path, *changes):
    text = OWN_DBC.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    place = tmp_path / "mine.dbc"
    place.write_text(text)
    return place


def wide_database(tmp_path):
    """Of a unit whose wheels may be steered further than its own DBC allows."""
    return UnitDatabase(altered(tmp_path, ('[-1.8|1.8] "rad"', '[-3|3] "rad"')))


@pytest.mark.parametrize("beyond", [1.8002, -1.8002, 3.0])
def test_values_beyond_their_range_are_refused_and_counted(tmp_path, beyond):
    vehicle, readings, wide = unit(), UnitReadings.empty(), wide_database(tmp_path)
    assert decode(vehicle, states(0, wide, SteeringAngle=1.8), readings, arrival_ns=1) == STATE_FRAMES
    assert decode(vehicle, states(1, wide, SteeringAngle=beyond), readings, arrival_ns=2) == STATE_FRAMES - 4
    np.testing.assert_allclose(readings.steering, 1.8)
    assert readings.reply_ns.tolist() == [1, 1, 1, 1, 2, 2]
    assert vehicle.counters[Counter.OUT_OF_RANGE] == vehicle.counters.sum() == 4


def whole(frame, draw):
    pass


def with_a_wrong_bit(frame, draw):
    frame["data"][0, draw(st.integers(0, int(frame["length"][0]) - 1))] ^= 1 << draw(st.integers(0, 7))


def of_another_length(frame, draw):
    frame["length"] = draw(st.integers(0, 8))


def with_a_flag(frame, draw):
    frame["can_id"] |= draw(st.sampled_from([CAN_ERR_FLAG, CAN_RTR_FLAG, CAN_EFF_FLAG]))


def of_another_kind(frame, draw):
    frame["can_id"] = draw(st.integers(0, 0x7FF))


MUTATIONS = (whole, with_a_wrong_bit, of_another_length, with_a_flag, of_another_kind)


@st.composite
def mutated(draw, database):
    """A state frame, whole or with one thing wrong; a wide database lets its values be beyond their range."""
    kind, alive = draw(st.integers(0, STATE_FRAMES - 1)), draw(st.integers(0, 3))
    frame = states(alive, database, SteeringAngle=draw(st.floats(-3.0, 3.0)))[[kind]]
    draw(st.sampled_from(MUTATIONS))(frame, draw)
    return frame.tobytes()


def test_no_bytes_raise_anything_and_each_is_taken_or_counted(tmp_path):
    packets = st.one_of(mutated(wide_database(tmp_path)), st.binary(min_size=16, max_size=16))
    found = np.zeros(len(Flaw), np.int64)

    @settings(max_examples=300)
    @given(st.lists(packets, max_size=8))
    def check(packets):
        vehicle, readings = unit(), UnitReadings.empty()
        accepted = decode(vehicle, np.frombuffer(b"".join(packets), CAN_FRAME), readings)
        flaws = vehicle.counters[FLAWS]
        assert accepted + flaws.sum() - flaws[Flaw.MISSED] == len(packets)
        assert (np.abs(readings.steering) <= 1.8).all()
        assert np.isfinite(readings.speed).all()
        found[:] += flaws

    check()
    assert {flaw.name for flaw in Flaw if not found[flaw]} == set()


def test_another_dbc_may_lay_the_same_signals_out_otherwise(tmp_path):
    dbc = altered(
        tmp_path,
        ("BO_ 257 WheelCommand_FL: 6", "BO_ 2147483905 WheelCommand_FL: 8"),
        ("SG_ BatteryVoltage : 16|16@1+ (0.01,0)", "SG_ BatteryVoltage : 23|16@0+ (0.02,0)"),
    )
    # what refers to the old identifier goes
    lines = [line for line in dbc.read_text().splitlines() if not (" 257 " in line and not line.startswith("BO_"))]
    dbc.write_text("\n".join(lines) + "\n")
    vehicle = unit(dbc)
    assert hex(encode(vehicle)["can_id"][1]) == "0x80000101"
    readings = UnitReadings.empty()
    decode(vehicle, states(database=vehicle.database, BatteryVoltage=48.0), readings)
    assert readings.battery[0] == pytest.approx(48.0)
    np.testing.assert_allclose([v["SteeringCommand"] for v in at_unit(vehicle.frames, vehicle.database)[1:]], ANGLES)


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        (" SG_ WheelSpeed :", " SG_ RotorSpeed :", "mine.dbc: message WheelState_FL: the signal WheelSpeed is missing"),
        ("UnitState:", "UnitCondition:", "mine.dbc: the message UnitState is missing"),
        (" SG_ AliveCounter :", " SG_ Pulse :", "the signal AliveCounter is missing"),
        (" SG_ Checksum : 0|8@1+", " SG_ Checksum : 0|4@1+", "signal Checksum: must be one whole byte"),
        ('(0.0001,0) [-1.65|1.65] "rad"', '(0.01,0) [-95|95] "deg"', "the unit is 'deg', not 'rad'"),
        ("BO_ 258 ", "BO_ 259 ", "mine.dbc:"),
        ("BO_ 256", "BOX 256", "mine.dbc: not a valid DBC"),
    ],
)
def test_a_dbc_that_does_not_do_is_refused_in_one_sentence(tmp_path, before, after, sentence):
    with pytest.raises(DriverConfigError) as caught:
        unit(altered(tmp_path, (before, after)))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_dbc_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(DriverConfigError, match=r"none\.dbc: cannot be read: No such file"):
        unit(tmp_path / "none.dbc")


def test_bus_load_is_checked():
    assert unit().check_bus_load(100, 500_000) == pytest.approx(0.263, abs=1e-3)
    with pytest.raises(DriverConfigError, match=r"can0: 100 Hz with the control unit loads 0.125 Mbit/s by 105.2%"):
        unit().check_bus_load(100, 125_000, "can0")
