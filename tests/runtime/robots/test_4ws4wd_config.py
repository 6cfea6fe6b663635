# SPDX-License-Identifier: Apache-2.0
"""The configuration of the vehicle holds together, and one that does not is refused in one sentence that says where."""

import pytest

from drivers.bus_load import MAX_BUS_LOAD
from runtime.configuration import dump, loads
from runtime.errors import ConfigError
from runtime.robots import assemble, assembled, description, load_configuration
from runtime.robots.vehicle_4ws4wd.config import PEERS, Vehicle4ws4wdConfig

CONTROLLERS = ("fuzzy-ldc", "fuzzy", "ldc", "pure-pursuit", "regulated", "steered-return", "mpc")

REFUSED = {
    "a tracker out of step": ({"loops.tracker_hz": "30"}, ("loops.tracker_hz", "30", "100")),
    "a period of fractions": (
        {"loops.drive_hz": "300", "loops.tracker_hz": "50"},
        ("loops.drive_hz", "300", "nanoseconds"),
    ),
    "a late budget": ({"loops.drive_budget_ns": "10000001"}, ("loops.drive_budget_ns", "10000001", "10000000")),
    "a full bus": (
        {"loops.drive_hz": "500", "loops.drive_budget_ns": "2000000", "drives.bit_rate_hz": "250000"},
        ("loops.drive_hz = 500", "0.25 Mbit/s"),
    ),
    "two buses": ({"drives.channels": '["can0", "can1"]'}, ("drives.channels", "one bus")),
    "no such DBC": ({"drives.dbc": "nowhere.dbc"}, ("drives.dbc", "nowhere.dbc")),
    "unknown controller": ({"variant.controller": "stanley"}, ("variant.controller", "stanley", "fuzzy-ldc")),
    "a delay beyond memory": ({"delay.maximum_s": "1.9"}, ("delay.maximum_s", "1.9")),
    "wheels that answer later than is waited for": (
        {"simulation.command_delay_ns": "600000000"},
        ("simulation.command_delay_ns = 600000000", "safety.refusal_ns = 300000000"),
    ),
    "steering that answers later than is waited for": (
        {"simulation.command_delay_ns": "600000000", "safety.refusal_ns": "1000000000"},
        ("simulation.command_delay_ns = 600000000", "safety.steering_stuck_ns = 500000000"),
    ),
    "another vehicle to track": (
        {"tracker.following.answer.wheelbase_m": "1.2"},
        ("tracker.following.answer.wheelbase_m = 1.2", "vehicle.wheelbase_m = 1.17"),
    ),
    "another vehicle to return": (
        {"controllers.steered_return.answer.wheelbase_m": "1.2"},
        ("controllers.steered_return.answer.wheelbase_m = 1.2", "vehicle.wheelbase_m = 1.17"),
    ),
    "another vehicle to predict": (
        {"controllers.mpc.wheelbase_m": "1.2"},
        ("controllers.mpc.wheelbase_m = 1.2", "vehicle.wheelbase_m = 1.17"),
    ),
    "a vehicle that grew": (
        {"vehicle.wheelbase_m": "1.3"},
        ("tracker.following.answer.wheelbase_m = 1.17", "vehicle.wheelbase_m = 1.3"),
    ),
    "two lags": (
        {"controllers.mpc.lag_s": "0.1"},
        ("controllers.mpc.lag_s = 0.1", "tracker.following.answer.lag_s = 0.05"),
    ),
    "a faster return than the steering": (
        {"controllers.steered_return.answer.rate_radps": "1.1"},
        ("controllers.steered_return.answer.rate_radps = 1.1", "tracker.following.answer.rate_radps = 1"),
    ),
    "a walker's key": (
        {"tracker.following.speed.lead_mps": "0.4"},
        ("tracker.following.speed.lead_mps", "unknown"),
    ),
    "a step off the period": ({"simulation.time_step_ns": "3000000"}, ("simulation.time_step_ns", "3000000")),
}


def test_the_vehicle_in_the_box_is_whole():
    config = load_configuration("4ws4wd")
    assert config.vehicle.mass_kg == pytest.approx(120.0)
    assert loads(dump(config), Vehicle4ws4wdConfig, place="again") == config
    assert 0.0 < config.bus_loads()[0] <= MAX_BUS_LOAD


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_work_is_refused_in_one_sentence(name):
    overrides, words = REFUSED[name]
    with pytest.raises(ConfigError) as caught:
        load_configuration("4ws4wd", overrides)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("estimator", ["kalman", "truth"])
def test_every_variant_can_be_assembled_from_its_own_text(controller, estimator):
    config = load_configuration("4ws4wd", {"variant.controller": controller, "variant.estimator": estimator})
    (loop,) = assemble("4ws4wd", dump(config))
    names = [item.task.name for item in loop.schedule]
    learning = [] if controller in PEERS else ["delay"]
    assert names == ["decode", "authority", "estimator", *learning, "tracker", "steering", "safety", "encode"]


def test_every_signal_has_one_writer_and_every_reader_a_source():
    (loop,) = assembled(load_configuration("4ws4wd")).loops
    written = [record.topic for record in loop.writes]
    assert len(set(written)) == len(written)
    sources = {record.topic for record in (*loop.port_inputs, *loop.writes)}
    assert {record.topic for item in loop.schedule for record in item.task.reads} <= sources


def test_the_description_has_the_joints_that_are_told():
    config = load_configuration("4ws4wd")
    text = description(config)
    for name in assembled(config).joint_names:
        assert f'joint name="{name}"' in text
