# SPDX-License-Identifier: Apache-2.0
"""Scenarios by name: what is asked for, and what is refused."""

import pytest

from sim_bridge.courses import UnknownScenarioError, scenario, scenario_names


@pytest.mark.parametrize("name", scenario_names())
def test_every_name_gives_its_scenario(name):
    course = scenario(name)
    assert course.name == name
    assert course.nominal_time_s > 0.0
    assert course.terrain(0).heights_m.size > 0


@pytest.mark.parametrize(("name", "length"), [("straight-18", 18.0), ("straight-2.5", 2.5)])
def test_a_straight_has_the_length_of_its_name(name, length):
    course = scenario(name)
    assert course.waypoints[0] == (0.0, 0.0)
    assert course.waypoints[-1] == pytest.approx((length, 0.0))
    assert course.nominal_time_s == pytest.approx(length / 0.6)
    assert course.with_speed(1.2).nominal_time_s == pytest.approx(length / 1.2)
    assert not course.terrain(0).heights_m.any()


@pytest.mark.parametrize("name", ["straight-0.5", "straight-101", "slope-up-36", "slope-down-0"])
def test_a_number_out_of_bounds_is_named(name):
    with pytest.raises(UnknownScenarioError, match=name):
        scenario(name)


@pytest.mark.parametrize(("name", "hint"), [("flot", "flat"), ("circle-6", "circle-6cm")])
def test_an_unknown_name_is_answered_with_the_nearest(name, hint):
    with pytest.raises(UnknownScenarioError, match=f"scenario '{name}' is unknown; did you mean {hint}"):
        scenario(name)
