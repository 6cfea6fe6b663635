# SPDX-License-Identifier: Apache-2.0
"""The codec against hand-made vectors, an independent big-integer reference, and its properties over all inputs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.dialects import AK_V3, CLASSIC_6, CLASSIC_7, CLASSIC_8, DAMIAO, DIALECTS, Ranges, dialect_named
from drivers.errors import DriverConfigError, NonFiniteError
from drivers.mit import DISABLE, ENABLE, SET_ZERO, MitCodec

RANGES = Ranges(
    position=(-12.5, 12.5), velocity=(-65.0, 65.0), effort=(-18.0, 18.0), stiffness=(0.0, 500.0), damping=(0.0, 5.0)
)
BITS = {"position": 16, "velocity": 12, "stiffness": 12, "damping": 12, "effort": 12}
ORDER = ("position", "velocity", "effort", "stiffness", "damping")
MIT_ORDER = ("position", "velocity", "stiffness", "damping", "effort")
AK_V3_ORDER = ("stiffness", "damping", "position", "velocity", "effort")


def reference(values, order):
    """The command as bytes, by big integers alone."""
    word = 0
    for name in order:
        low, high = getattr(RANGES, name)
        code = round((values[name] - low) * (2 ** BITS[name] - 1) / (high - low))
        word = word << BITS[name] | code
    return word.to_bytes(8, "big")


def encoded(dialect, **values):
    codec, out = MitCodec(dialect, RANGES, 1), np.zeros(1, ">u8")
    clipped = codec.encode_commands(*([values[name]] for name in ORDER), out)
    return out.tobytes(), clipped


def within(name):
    low, high = getattr(RANGES, name)
    return st.floats(low, high)


commands = st.fixed_dictionaries({name: within(name) for name in ORDER})


@pytest.mark.parametrize(
    ("values", "classic", "ak_v3"),
    [
        # lowest codes of all: zeros
        ((-12.5, -65.0, -18.0, 0.0, 0.0), "0000000000000000", "0000000000000000"),
        # position ffff, the rest lowest
        ((12.5, -65.0, -18.0, 0.0, 0.0), "ffff000000000000", "000000ffff000000"),
        # velocity fff
        ((-12.5, 65.0, -18.0, 0.0, 0.0), "0000fff000000000", "0000000000fff000"),
        # kp fff
        ((-12.5, -65.0, -18.0, 500.0, 0.0), "0000000fff000000", "fff0000000000000"),
        # kd fff
        ((-12.5, -65.0, -18.0, 0.0, 5.0), "0000000000fff000", "000fff0000000000"),
        # torque fff
        ((-12.5, -65.0, 18.0, 0.0, 0.0), "0000000000000fff", "0000000000000fff"),
        # p 1 -> 13.5 * 65535 / 25 = 35388.9 -> 8a3d; v 0 -> 2047.5 -> even 2048 = 800; kp 100 -> 819 = 333;
        # kd 2 -> 1638 = 666; t 9 -> 27 * 4095 / 36 = 3071.25 -> bff
        ((1.0, 0.0, 9.0, 100.0, 2.0), "8a3d800333666bff", "3336668a3d800bff"),
    ],
)
def test_commands_by_hand(values, classic, ak_v3):
    named = dict(zip(ORDER, values, strict=True))
    assert encoded(CLASSIC_8, **named) == (bytes.fromhex(classic), False)
    assert encoded(DAMIAO, **named) == (bytes.fromhex(classic), False)
    assert encoded(AK_V3, **named) == (bytes.fromhex(ak_v3), False)


@pytest.mark.parametrize(
    ("dialect", "data", "expected"),
    [
        # id 5, p 8a3d, v 800, t bff
        (CLASSIC_6, "058a3d800bff", {"id": 5, "position": 35389, "velocity": 2048, "effort": 3071}),
        (CLASSIC_7, "058a3d800bff30", {"id": 5, "position": 35389, "effort": 3071, "voltage": 48.0}),
        (CLASSIC_8, "058a3d800bff2a03", {"id": 5, "velocity": 2048, "temperature": 42.0, "error": 3}),
        (DAMIAO, "b58a3d800bff2a37", {"id": 5, "error": 11, "driver_temperature": 42.0, "temperature": 55.0}),
        (AK_V3, "058a3d800bff2a06", {"id": 5, "position": 35389, "temperature": 42.0, "error": 6}),
    ],
)
def test_replies_by_hand(dialect, data, expected):
    codec = MitCodec(dialect, RANGES, 1)
    raw = bytes.fromhex(data)
    assert dialect.reply_length == len(raw)
    word = np.frombuffer(raw.ljust(8, b"\0"), ">u8")
    values = codec.decode_replies(word)
    for name, code in expected.items():
        value = code
        if name in BITS:
            low, high = getattr(RANGES, name)
            value = low + code * (high - low) / (2 ** BITS[name] - 1)
        assert values[codec.replies.rows[name], 0] == pytest.approx(value, abs=1e-9)
    again = np.zeros(1, ">u8")
    assert not codec.encode_replies(values.copy(), again)
    assert again.tobytes() == word.tobytes()


def test_special_frames():
    assert [frame.hex() for frame in (ENABLE, DISABLE, SET_ZERO)] == ["ff" * 7 + end for end in ("fc", "fd", "fe")]


@given(commands)
def test_commands_equal_the_reference(values):
    assert encoded(CLASSIC_8, **values)[0] == reference(values, MIT_ORDER)
    assert encoded(AK_V3, **values)[0] == reference(values, AK_V3_ORDER)


@pytest.mark.parametrize("name", sorted(DIALECTS))
@given(data=st.data())
@settings(max_examples=50)
def test_a_round_trip_is_within_half_a_code(name, data):
    count = 12
    codec, out = MitCodec(DIALECTS[name], RANGES, count), np.zeros(count, ">u8")
    values = np.array([[data.draw(within(field)) for _ in range(count)] for field in ORDER])
    assert not codec.encode_commands(*values, out)
    error = np.abs(codec.decode_commands(out) - values)
    for row, field in enumerate(ORDER):
        low, high = getattr(RANGES, field)
        assert error[row].max() <= 0.5 * (high - low) / (2 ** BITS[field] - 1) * (1 + 1e-9)


@given(st.sampled_from(ORDER), st.data())
def test_codes_grow_with_the_value(name, data):
    one, other = sorted(data.draw(st.tuples(within(name), within(name))))
    base = dict.fromkeys(ORDER, 0.0)
    low, high = (int.from_bytes(encoded(CLASSIC_8, **{**base, name: value})[0], "big") for value in (one, other))
    assert low <= high


@given(st.sampled_from(ORDER), st.floats(1e-3, 1e6), st.booleans())
def test_beyond_the_range_is_clipped_and_counted(name, excess, above):
    low, high = getattr(RANGES, name)
    codec, out = MitCodec(CLASSIC_8, RANGES, 2), np.zeros(2, ">u8")
    values = {field: np.zeros(2) for field in ORDER}
    values[name] = np.array([high + excess if above else low - excess, 0.5 * (low + high)])
    assert codec.encode_commands(*values.values(), out)
    assert codec.commands.clipped.tolist() == [int(field == name) for field in ORDER]
    assert codec.decode_commands(out)[ORDER.index(name), 0] == pytest.approx(high if above else low)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ORDER)
def test_a_value_that_is_not_finite_is_refused_and_named(name, bad):
    codec, out = MitCodec(CLASSIC_8, RANGES, 3), np.full(3, 7, ">u8")
    values = {field: np.zeros(3) for field in ORDER}
    values[name][1] = bad
    with pytest.raises(NonFiniteError, match=f"{name} of drive 1 is"):
        codec.encode_commands(*values.values(), out)
    assert out.tolist() == [7, 7, 7]


@pytest.mark.parametrize("dialect", [CLASSIC_8, AK_V3])
def test_no_command_is_ever_a_special_frame(dialect):
    codec, out = MitCodec(dialect, RANGES, 1), np.zeros(1, ">u8")
    for code in range(4088, 4096):
        effort = -18.0 + code * 36.0 / 4095
        clipped = codec.encode_commands([12.5], [65.0], [effort], [500.0], [5.0], out)
        assert out.tobytes() not in (ENABLE, DISABLE, SET_ZERO)
        assert clipped == (code in (0xFFC, 0xFFD, 0xFFE))


def test_each_drive_has_its_own_ranges():
    wide = Ranges((-12.5, 12.5), (-130.0, 130.0), (-36.0, 36.0), (0.0, 500.0), (0.0, 5.0))
    codec, out = MitCodec(CLASSIC_8, [RANGES, wide]), np.zeros(2, ">u8")
    codec.encode_commands([0, 0], [10, 20], [5, 10], [0, 0], [0, 0], out)
    assert out[0] == out[1]


def test_bad_tables_are_refused_in_one_sentence():
    with pytest.raises(DriverConfigError, match=r"velocity: 5\.0 to 5\.0"):
        Ranges((-12.5, 12.5), (5.0, 5.0), (-18.0, 18.0), (0.0, 500.0), (0.0, 5.0))
    with pytest.raises(DriverConfigError, match="'klassic' is unknown; there are ak-v3, classic-6"):
        dialect_named("klassic")
    assert dialect_named("damiao") is DAMIAO
