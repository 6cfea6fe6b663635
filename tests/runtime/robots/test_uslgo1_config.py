# SPDX-License-Identifier: Apache-2.0
"""The configuration of USLGO1 holds together, and one that does not is refused in one sentence that says where."""

import pytest

from drivers.bus_load import MAX_BUS_LOAD, worst_bus_load
from drivers.dialects import DIALECTS
from runtime.configuration import dump, loads
from runtime.errors import ConfigError
from runtime.robots import assemble, configuration_file, load_configuration
from runtime.robots.uslgo1.assembly import sizes
from runtime.robots.uslgo1.config import Uslgo1Config

TWO_BUSES = "[0,0,0,0,0,0,1,1,1,1,1,1]"
TWO_IDS = "[1,2,3,4,5,6,1,2,3,4,5,6]"
TWO_CHANNELS = '["can0", "can1"]'

REFUSED = {
    "two full buses": (
        {"loops.wbc_hz": "1000", "drives.bus": TWO_BUSES, "drives.channels": TWO_CHANNELS, "drives.can_id": TWO_IDS},
        ("loops.wbc_hz", "1000", "bus 0", "85%"),
    ),
    "extended frames": (
        {"loops.wbc_hz": "1000", "drives.dialect": "ak-v3", "drives.bit_rate_hz": "500000"},
        ("loops.wbc_hz", "ak-v3", "bus 0"),
    ),
    "slow bus": ({"drives.bit_rate_hz": "250000"}, ("loops.wbc_hz = 500", "0.25 Mbit/s")),
    "all on one bus": (
        {
            "drives.bus": "[0,0,0,0,0,0,0,0,0,0,0,0]",
            "drives.channels": '["can0"]',
            "drives.can_id": "[1,2,3,4,5,6,7,8,9,10,11,12]",
        },
        ("wbc_hz",),
    ),
    "stance off the grid": ({"gait.stance_fraction": "0.55"}, ("gait.stance_fraction", "0.55", "mpc.steps")),
    "period off the grid": ({"gait.period_ns": "400000001"}, ("gait.period_ns", "mpc.steps")),
    "a bus without a channel": (
        {"drives.channels": '["can0", "can1", "can2"]'},
        ("drives.channels", "4 different buses"),
    ),
    "eleven joints": ({"drives.bus": "[0,0,0,1,1,1,2,2,2,3,3]"}, ("drives.bus", "11 entries for 12 joints")),
    "thirteen offsets": ({"drives.offset_rad": "[0,0,0,0,0,0,0,0,0,0,0,0,0]"}, ("drives.offset_rad", "13 entries")),
    "mpc rate": ({"loops.mpc_hz": "60"}, ("loops.mpc_hz", "60", "500")),
    "tracker rate": ({"loops.tracker_hz": "30"}, ("loops.tracker_hz", "30", "50")),
    "wbc period": ({"loops.wbc_hz": "300", "loops.mpc_hz": "50"}, ("loops.wbc_hz", "300", "nanoseconds")),
    "wbc budget": ({"loops.wbc_budget_ns": "2000001"}, ("loops.wbc_budget_ns", "2000001", "2000000")),
    "mpc budget": ({"loops.mpc_budget_ns": "20000001"}, ("loops.mpc_budget_ns", "20000000")),
    "too tall": ({"posture.height_m": "0.42", "quadruped.shank_length_m": "0.15"}, ("posture.height_m", "0.42")),
    "crossed limits": ({"safety.position_min_rad": "[-1.0, 1.6, 0.05]"}, ("safety", "position_min_rad", "1.6")),
    "crossed voltages": ({"safety.voltage_min_v": "35"}, ("safety.voltage_min_v", "35")),
    "unknown dialect": ({"drives.dialect": "klingon"}, ("klingon", "classic-8")),
    "direction": ({"drives.direction": "[1,1,1,-1,-1,-1,1,1,1,-1,-1,0]"}, ("drives", "direction = 0")),
    "torque beyond the drive": ({"safety.effort_max_nm": "41"}, ("effort", "41")),
    "unknown solver": ({"variant.solver": "osqp"}, ("variant.solver", "osqp")),
    "unknown key": ({"gait.phase": "1"}, ("gait.phase",)),
    "negative mass": ({"quadruped.trunk.mass_kg": "-1"}, ("quadruped.trunk.mass_kg",)),
    "nan": ({"mpc.friction": "nan"}, ("mpc.friction",)),
    "load bounds crossed": ({"mpc.force_min_n": "60", "mpc.force_max_n": "40"}, ("mpc", "force_min_n")),
    "two drives on one address": ({"drives.can_id": "[1,1,3,1,2,3,1,2,3,1,2,3]"}, ("drives",)),
}


def test_the_robot_in_the_box_is_whole():
    config = load_configuration("uslgo1")
    assert config.quadruped.mass_kg == pytest.approx(12.786)
    assert loads(dump(config), Uslgo1Config, place="again") == config
    assert config.safety.effort_max_nm <= config.simulation.peak_torque_nm


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_work_is_refused_in_one_sentence(name):
    overrides, words = REFUSED[name]
    with pytest.raises(ConfigError) as caught:
        load_configuration("uslgo1", overrides)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


@pytest.mark.parametrize("dialect", DIALECTS)
def test_what_is_accepted_fits_on_the_bus_and_what_is_refused_does_not(dialect):
    for rate in (100, 250, 500, 1000):
        load = worst_bus_load(DIALECTS[dialect], 3, rate, 1_000_000)
        overrides = {"drives.dialect": dialect, "loops.wbc_hz": str(rate), "loops.wbc_budget_ns": "800000"}
        masters = {"drives.master_id": "[" + ",".join(str(17 + i) for i in range(12)) + "]"}
        try:
            load_configuration("uslgo1", {**overrides, **masters})
            accepted = True
        except ConfigError as error:
            accepted = False
            assert "bus" in str(error)
        assert accepted == (load <= MAX_BUS_LOAD)


def test_a_thousand_hertz_fits_on_four_buses_of_three():
    assert load_configuration("uslgo1", {"loops.wbc_hz": "1000"}).loops.wbc_period_ns == 1_000_000


def test_unknown_robots_are_told_which_there_are():
    with pytest.raises(ConfigError, match="uslgo1"):
        configuration_file("uslgo2")
    with pytest.raises(ConfigError, match="uslgo1"):
        load_configuration("spot")


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"variant.estimator": "truth"},
        {"variant.controller": "FpM"},
        {"mpc.steps": "16", "gait.period_ns": "320000000"},
    ],
)
def test_every_variant_can_be_assembled_from_its_own_text(change):
    config = load_configuration("uslgo1", change)
    loops = assemble("uslgo1", dump(config))
    assert [loop.name for loop in loops] == ["wbc", "mpc"]
    names = [item.task.name for loop in loops for item in loop.schedule]
    assert len(set(names)) == len(names)


def test_every_signal_has_one_writer_and_every_reader_a_source():
    loops = assemble("uslgo1", dump(load_configuration("uslgo1")))
    written = [record.topic for loop in loops for record in loop.writes]
    assert len(set(written)) == len(written)
    for loop in loops:
        sources = {id(record) for record in (*loop.port_inputs, *loop.receives, *loop.writes)}
        for item in loop.schedule:
            for record in item.task.reads:
                assert id(record) in sources, (loop.name, item.task.name, record.topic)
        for record in loop.receives:
            assert record.topic in written


def test_sizes_follow_the_horizon():
    lengths = sizes(load_configuration("uslgo1", {"mpc.steps": "16", "gait.period_ns": "320000000"}))
    assert (lengths["knot"], lengths["horizon_foot"], lengths["horizon_xyz"]) == (17, 64, 192)
