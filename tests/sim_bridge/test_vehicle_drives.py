# SPDX-License-Identifier: Apache-2.0
"""Courses of the vehicle that are not experiments of paper 002, driven to their ends by the default estimator."""

import pytest

from runtime.robots import load_configuration
from sim_bridge.run import run_scenario
from sim_bridge.vehicle_model import GRAVITY_MPS2

SPEED_KEY, LATERAL_KEY = "scenario.speed_mps", "tracker.following.speed.lateral_acceleration_mps2"
BLIND = {"tracker.traction.lateral_mps": "2.0", "tracker.traction.rolling_mps": "2.0"}
"""A vehicle that takes no side slip for what it is."""


@pytest.mark.parametrize(
    ("scenario", "lateral_m", "heading_rad"),
    [
        ("slope-up-10", 0.05, 0.05),
        ("slope-down-10", 0.05, 0.05),
        ("rough-3cm", 0.05, 0.05),
        ("diagonal", 0.05, 0.05),
    ],
)
def test_ground_and_ways_of_its_own_are_driven_to_their_end(scenario, lateral_m, heading_rad):
    summary = run_scenario("4ws4wd", scenario)
    assert summary["completed"]
    assert not summary["fell"]
    assert summary["fault"] == ""
    assert summary["lateral_error_m"]["max"] < lateral_m
    assert summary["heading_error_rad"]["max"] < heading_rad
    assert summary["speed_mps"]["mean"] == pytest.approx(summary["speed_mps"]["commanded"], rel=0.1)


def test_other_controllers_than_the_papers_are_sooner_on_the_line_though_commands_are_late():
    late = {"simulation.command_delay_ns": "200000000"}
    papers = run_scenario("4ws4wd", "straight", overrides=late)
    for controller in ("steered-return", "mpc"):
        other = run_scenario("4ws4wd", "straight", controller=controller, overrides=late)
        assert other["completed"], controller
        assert other["fault"] == "", controller
        assert other["lateral_error_m"]["mean"] < papers["lateral_error_m"]["mean"], controller


def over_the_patch(changes):
    """Round a slippery bend by a vehicle that counts on half of the grip of other ground, at 3 m/s."""
    friction = load_configuration("4ws4wd").simulation.terrain_friction
    bold = {SPEED_KEY: "3.0", LATERAL_KEY: str(0.5 * friction * GRAVITY_MPS2)}
    return run_scenario("4ws4wd", "slippery-bend", overrides={**bold, **changes})


def test_on_a_slippery_bend_it_slows_down_keeps_to_its_path_and_does_not_spin():
    seeing, blind = over_the_patch({}), over_the_patch(BLIND)
    assert seeing["completed"]
    assert seeing["patch"]["speed_entry_mps"] == pytest.approx(3.0, abs=0.1)
    assert seeing["patch"]["speed_least_mps"] < 0.7 * seeing["patch"]["speed_entry_mps"]
    assert seeing["lateral_error_m"]["max"] < 0.15
    assert seeing["heading_error_rad"]["max"] < 0.3
    assert seeing["patch"]["side_slip_max_rad"] < 0.25
    # one that does not notice is driven on by the bend's own limit
    assert blind["patch"]["speed_least_mps"] > 0.8 * blind["patch"]["speed_entry_mps"]
    assert blind["patch"]["side_slip_max_rad"] > seeing["patch"]["side_slip_max_rad"]


def test_by_its_own_limits_it_keeps_its_hold_on_the_slippery_bend_and_notices_nothing_where_tyres_hold():
    summary = run_scenario("4ws4wd", "slippery-bend", overrides={SPEED_KEY: "3.0"})
    limits = load_configuration("4ws4wd").tracker.following.speed
    by_the_bend = (limits.lateral_acceleration_mps2 * 2.5) ** 0.5
    assert summary["completed"]
    assert summary["lateral_error_m"]["max"] < 0.06
    assert summary["patch"]["side_slip_max_rad"] < 0.05
    assert summary["patch"]["speed_least_mps"] < 1.01 * by_the_bend
    fast = run_scenario("4ws4wd", "figure-eight", overrides={SPEED_KEY: "3.0"})
    blind = run_scenario("4ws4wd", "figure-eight", overrides={SPEED_KEY: "3.0", **BLIND})
    assert fast["completion_time_s"] == pytest.approx(blind["completion_time_s"], rel=0.02)
