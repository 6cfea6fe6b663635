# SPDX-License-Identifier: Apache-2.0
"""Every scenario of the vehicle is whole, and the names that there are none of are refused."""

import math

import numpy as np
import pytest

from runtime.tracking.curvature import mean_curvature
from runtime.tracking.errors import PathError
from runtime.tracking.paths import Polyline
from runtime.tracking.sections import SectionedPath
from sim_bridge.vehicle_courses import UnknownScenarioError, custom, scenario, scenario_names


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_is_whole(name):
    course = scenario(name)
    assert course.name == name
    x, y, _ = course.start_pose
    ground = course.terrain(0)
    assert math.isfinite(ground.height_at(x, y))
    assert course.time_limit_s > 0.0
    if course.waypoints:
        path = SectionedPath(course.waypoints, course.closed)
        assert path.length <= course.speed_mps * course.nominal_time_s
        low_x, high_x, low_y, high_y = ground.extent
        assert all(low_x <= px <= high_x and low_y <= py <= high_y for px, py in course.waypoints)


def test_the_papers_experiments_start_beside_their_paths():
    assert scenario("straight").start_pose == pytest.approx((0.0, 1.5, 0.0))
    assert math.dist(scenario("curve-u").start_pose[:2], scenario("curve-u").waypoints[0]) == pytest.approx(1.0)


def test_the_seed_chooses_the_curve():
    names = {scenario("curve", seed).name for seed in range(5)}
    assert names == {"curve-u", "curve-s", "curve-right-angle", "curve-loop", "curve-chicane"}
    assert scenario("curve", 5).name == scenario("curve", 0).name


def test_the_three_point_turn_has_two_cusps_and_ends_the_other_way_round():
    course = scenario("three-point-turn")
    path = SectionedPath(course.waypoints)
    assert [round(section.length, 1) for section in path.sections] == [4.6, 2.6, 5.6]
    assert abs(math.remainder(path.sections[-1].heading(path.sections[-1].length) - math.pi, math.tau)) < 1e-6
    assert path.goal == pytest.approx((2.0 - 3.0, 0.0))  # the chords of the arcs make up a triangle
    assert course.nominal_time_s == pytest.approx(path.length / 0.6 + 3 * 4.0)
    assert course.with_speed(1.2).nominal_time_s == pytest.approx(path.length / 1.2 + 3 * 4.0)


def test_a_path_of_ones_own_may_turn_back():
    course = custom([(0.0, 0.0), (2.0, 0.0), (1.0, 0.0)])
    assert course.start_pose == (0.0, 0.0, 0.0)
    assert course.nominal_time_s == pytest.approx(3.0 / 0.6 + 2 * 4.0)
    with pytest.raises(PathError, match="2 are needed"):
        custom([(0.0, 0.0)])


def test_only_paths_are_closed_that_lead_back():
    assert scenario("figure-eight").closed
    assert not scenario("slalom").closed


def test_the_slippery_bend_lies_on_its_patch_whole_and_the_other_bend_does_not():
    course = scenario("slippery-bend")
    path, (patch,) = Polyline(course.waypoints), course.patches
    bent = [s for s in np.arange(0.0, path.length, 0.1) if abs(mean_curvature(path, s, 0.6)) > 0.2]
    on_it = np.array([patch.holds(*path.point(s)) for s in bent])
    first = np.array([mean_curvature(path, s, 0.6) > 0.0 for s in bent])
    assert (on_it == first).all()
    assert patch.friction == 0.3
    assert 0 < first.sum() < len(first)


@pytest.mark.parametrize("name", ["circle-6cm", "straight-0.5", "straight-101", "wheelie", ""])
def test_what_there_is_not_is_refused(name):
    with pytest.raises(UnknownScenarioError, match="scenario"):
        scenario(name)
