# SPDX-License-Identifier: Apache-2.0
"""Whatever is wrong with a configuration is said in one sentence with place, key, value and bound."""

import enum
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.configuration import dump, loads, parse_overrides, read
from runtime.errors import ConfigError


class Solver(enum.Enum):
    DAQP = "daqp"
    PROXQP = "proxqp"


class Wbc(msgspec.Struct, forbid_unknown_fields=True):
    rate_hz: Annotated[float, msgspec.Meta(ge=50, le=1000)]
    torque_nm: Annotated[float, msgspec.Meta(gt=0.0, lt=40.0)] = 33.0
    inertia_kg_m2: float = 0.01
    solver: Literal["daqp", "proxqp"] = "daqp"
    fallback: Solver = Solver.PROXQP


class Leg(msgspec.Struct, forbid_unknown_fields=True):
    offset_m: tuple[float, float, float]
    joints: Annotated[list[str], msgspec.Meta(min_length=1, max_length=3)] = msgspec.field(
        default_factory=lambda: ["a"]
    )


class Robot(msgspec.Struct, forbid_unknown_fields=True):
    name: Annotated[str, msgspec.Meta(min_length=1, max_length=20, pattern="^[a-z0-9]+$")]
    wbc: Wbc
    legs: list[Leg]
    count: Annotated[int, msgspec.Meta(ge=1, le=64, multiple_of=2)] = 12
    armed: bool = False
    limit_v: float | None = None
    gains: dict[str, Annotated[float, msgspec.Meta(ge=0)]] = msgspec.field(default_factory=dict)

    def check(self) -> None:
        if self.wbc.rate_hz * self.count > 12000:
            raise ConfigError(
                f"wbc.rate_hz = {self.wbc.rate_hz:g} with {self.count} joints is more than the bus carries"
            )


TEXT = """
name = "uslgo1"
[wbc]
rate_hz = 500
[[legs]]
offset_m = [0.18, 0.047, 0]
[gains]
knee = 1.5
"""


def problem(text: str = TEXT, **overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        loads(text, Robot, place="uslgo1.toml", overrides={k.replace("__", "."): v for k, v in overrides.items()})
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_valid_text_becomes_a_struct() -> None:
    robot = loads(TEXT, Robot, place="uslgo1.toml")
    assert robot.wbc.rate_hz == 500.0
    assert robot.legs[0].offset_m == (0.18, 0.047, 0.0)
    assert robot.wbc.fallback is Solver.PROXQP


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rate_hz = 500", "rate_hz = 5000", "uslgo1.toml: wbc.rate_hz = 5000 is above 1000"),
        ("rate_hz = 500", "rate_hz = 1.5", "uslgo1.toml: wbc.rate_hz = 1.5 is below 50"),
        ("rate_hz = 500", "rate_hz = 500\ntorque_nm = 0", "uslgo1.toml: wbc.torque_nm = 0 is not above 0"),
        ("rate_hz = 500", "rate_hz = 500\ntorque_nm = 40", "uslgo1.toml: wbc.torque_nm = 40 is not below 40"),
        (
            "rate_hz = 500",
            "rate_khz = 0.5",
            "uslgo1.toml: wbc.rate_khz is unknown; did you mean wbc.rate_hz? It wants Hz, not kHz",
        ),
        (
            "rate_hz = 500",
            "rate = 500",
            "uslgo1.toml: wbc.rate is unknown; did you mean wbc.rate_hz? It wants Hz",
        ),
        (
            "rate_hz = 500",
            "rate_hz = 500\ninertia_kg = 1",
            "uslgo1.toml: wbc.inertia_kg is unknown; did you mean wbc.inertia_kg_m2? It wants kg.m^2, not kg",
        ),
        ("rate_hz = 500", "raet_hz = 500", "uslgo1.toml: wbc.raet_hz is unknown; did you mean wbc.rate_hz?"),
        (
            "rate_hz = 500",
            'rate_hz = "500 Hz"',
            'uslgo1.toml: wbc.rate_hz = "500 Hz" is text with a unit; write the number alone, in Hz',
        ),
        ("rate_hz = 500", 'rate_hz = "fast"', 'uslgo1.toml: wbc.rate_hz = "fast" is text, wants a number in Hz'),
        ("rate_hz = 500", "rate_hz = true", "uslgo1.toml: wbc.rate_hz = true is a truth value, wants a number in Hz"),
        ("rate_hz = 500", "rate_hz = nan", "uslgo1.toml: wbc.rate_hz = nan is not finite"),
        ("rate_hz = 500", "rate_hz = -inf", "uslgo1.toml: wbc.rate_hz = -inf is not finite"),
        ("rate_hz = 500", "", "uslgo1.toml: wbc.rate_hz is missing"),
        (
            "rate_hz = 500",
            'rate_hz = 500\nsolver = "dapq"',
            'uslgo1.toml: wbc.solver = "dapq" is not one of daqp, proxqp; did you mean daqp?',
        ),
        ("0.047, 0]", "0.047]", "uslgo1.toml: legs.0.offset_m = [0.18, 0.047] has 2 entries, wants 3"),
        ("0.047, 0]", '"x", 0]', 'uslgo1.toml: legs.0.offset_m.1 = "x" is text, wants a number in m'),
        ("knee = 1.5", "knee = -1.5", "uslgo1.toml: gains.knee = -1.5 is below 0"),
        ('name = "uslgo1"', 'name = "USL"', 'uslgo1.toml: name = "USL" does not look like ^[a-z0-9]+$'),
        ('name = "uslgo1"', 'name = "a"\ncount = 3', "uslgo1.toml: count = 3 is not a multiple of 2"),
        ('name = "uslgo1"', 'name = "a"\ncount = 2.5', "uslgo1.toml: count = 2.5 is not a whole number"),
        ('name = "uslgo1"', 'name = "a"\narmed = 1', "uslgo1.toml: armed = 1 is a number, wants true or false"),
        ('name = "uslgo1"', 'name = "a"\nlimit_v = "x"', 'uslgo1.toml: limit_v = "x" is text, wants a number in V'),
        ('name = "uslgo1"', 'name = "a"\ncount = 1' + "0" * 30, "uslgo1.toml: count = 1e+30 is too large"),
        (
            "rate_hz = 500",
            "rate_hz = 1000\n[extra]",
            "uslgo1.toml: extra is unknown; known there: name, wbc, legs, count, armed, limit_v, gains",
        ),
        (
            'name = "uslgo1"',
            'name = "a"\ncount = 26',
            "uslgo1.toml: wbc.rate_hz = 500 with 26 joints is more than the bus carries",
        ),
    ],
)
def test_a_flaw_in_the_file_is_named(old: str, new: str, sentence: str) -> None:
    assert problem(TEXT.replace(old, new)) == sentence


def test_broken_toml_is_named_with_its_line() -> None:
    assert problem('name = "uslgo1"\nwbc =\n').startswith("uslgo1.toml: line 2, column 6: not valid TOML")


@pytest.mark.parametrize("text", ["a = " + "[" * 100_000, "a = 1\na = 2", "a = " + "9" * 10_000, '"a\\nb" = 1', "\x00"])
def test_hostile_text_is_refused_in_one_line(text: str) -> None:
    assert problem(text).startswith("uslgo1.toml: ")


def test_an_override_replaces_what_the_file_says() -> None:
    robot = loads(TEXT, Robot, place="x", overrides={"wbc.rate_hz": "400", "name": "b", "legs.0.offset_m.2": "0.5"})
    assert (robot.wbc.rate_hz, robot.name, robot.legs[0].offset_m[2]) == (400.0, "b", 0.5)


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("wbc__rate_hz", "5000", "--set: wbc.rate_hz = 5000 is above 1000"),
        ("wbc__rate_hz", "nan", "--set: wbc.rate_hz = nan is not finite"),
        ("wbc__rate_hz", "500 Hz", '--set: wbc.rate_hz = "500 Hz" is text with a unit; write the number alone, in Hz'),
        ("wbc__rate_khz", "1", "--set: wbc.rate_khz is unknown; did you mean wbc.rate_hz? It wants Hz, not kHz"),
        ("wcb__rate_hz", "1", "--set: wcb is unknown; did you mean wbc?"),
        ("legs__1__offset_m", "[0, 0, 0]", "--set: legs.1.offset_m is unknown; the list has 1 entries, from 0"),
        ("count", "26", "--set: wbc.rate_hz = 500 with 26 joints is more than the bus carries"),
    ],
)
def test_a_flaw_in_an_override_is_named(key: str, value: str, sentence: str) -> None:
    assert problem(**{key: value}) == sentence


def test_assignments_are_split_at_the_first_equals_sign() -> None:
    assert parse_overrides(["a.b = 1", "c=d=e", "a.b=2"]) == {"a.b": "2", "c": "d=e"}


@pytest.mark.parametrize("assignment", ["wbc.rate_hz", "=5", ""])
def test_an_assignment_without_key_or_value_is_refused(assignment: str) -> None:
    with pytest.raises(ConfigError, match="wants KEY=VALUE"):
        parse_overrides([assignment])


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "none.toml", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(ConfigError, match=reason):
            read(path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"a = '\xff'")
    with pytest.raises(ConfigError, match=r"binary.toml: byte 5 is not UTF-8"):
        read(binary)


KEYS = st.sampled_from(
    ["wbc", "wbc.rate_hz", "wbc.solver", "legs", "legs.0", "legs.0.offset_m", "legs.0.offset_m.0", "count", "armed"]
) | st.text(max_size=12)


@given(st.dictionaries(KEYS, st.text(max_size=20) | st.floats().map(str) | st.integers().map(str), max_size=3))
def test_any_override_is_taken_or_refused_in_one_line(overrides: dict[str, str]) -> None:
    try:
        robot = loads(TEXT, Robot, place="uslgo1.toml", overrides=overrides)
    except ConfigError as error:
        assert str(error).isprintable()
        assert str(error).startswith("--set: ")
    else:
        assert 50 <= robot.wbc.rate_hz <= 1000


BARE = st.recursive(
    st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from(["name", "wbc", "legs", "count", "armed", "limit_v", "gains"]), BARE)
def test_any_value_in_a_file_is_taken_or_refused_in_one_line(key: str, value: object) -> None:
    import tomli_w

    raw = {"name": "a", "wbc": {"rate_hz": 500}, "legs": [], key: value}
    try:
        loads(tomli_w.dumps(raw), Robot, place="uslgo1.toml")
    except ConfigError as error:
        assert str(error).isprintable()


RATES = st.floats(50, 150)
ROBOTS = st.builds(
    Robot,
    name=st.from_regex("[a-z0-9]{1,20}", fullmatch=True),
    wbc=st.builds(Wbc, rate_hz=RATES, torque_nm=st.floats(0.1, 39.9), fallback=st.sampled_from(Solver)),
    legs=st.lists(st.builds(Leg, offset_m=st.tuples(*[st.floats(-1, 1)] * 3)), max_size=4),
    count=st.integers(1, 32).map(lambda half: 2 * half),
    limit_v=st.none() | st.floats(-1e9, 1e9),
    gains=st.dictionaries(st.text(max_size=5), st.floats(0, 1e12), max_size=3),
)


@given(ROBOTS)
def test_a_configuration_survives_being_written(robot: Robot) -> None:
    text = dump(robot)
    assert loads(text, Robot, place="again") == robot
    assert dump(loads(text, Robot, place="again")) == text
