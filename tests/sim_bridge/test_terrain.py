# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.paths import PathError, Polyline, s_curve
from sim_bridge import courses, terrain
from sim_bridge.courses import UnknownScenarioError, scenario, scenario_names
from sim_bridge.terrain import HeightField

BIG = (0.0, 40.0, 0.0, 40.0)
ALL = (*scenario_names(), "slope-up-10", "slope-down-25", "slope-up-7.5")
FIELD = HeightField(-1.0, 2.0, 0.5, np.random.Generator(np.random.PCG64(1)).normal(size=(6, 9)))


@given(st.floats(-1.0, 3.0), st.floats(2.0, 4.5))
def test_normal_is_that_of_the_bilinear_surface(x, y):
    step = 1e-6
    cell = ((x + 1.0) / 0.5, (y - 2.0) / 0.5)
    if any(abs(c - round(c)) < 1e-3 for c in cell):
        return
    slope_x = float(FIELD.height(x + step, y) - FIELD.height(x - step, y)) / (2 * step)
    slope_y = float(FIELD.height(x, y + step) - FIELD.height(x, y - step)) / (2 * step)
    normal = FIELD.normal(x, y)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    np.testing.assert_allclose(normal[:2] / normal[2], (-slope_x, -slope_y), atol=1e-6)


def test_heights_at_grid_points_are_those_of_the_grid():
    rows, columns = FIELD.heights_m.shape
    x, y = np.meshgrid(-1.0 + 0.5 * np.arange(columns), 2.0 + 0.5 * np.arange(rows))
    np.testing.assert_allclose(FIELD.height(x, y), FIELD.heights_m, atol=1e-12)
    assert FIELD.height(-50.0, -50.0) == FIELD.heights_m[0, 0]


@pytest.mark.parametrize(("amplitude", "rms"), [(0.03, 0.0086), (0.06, 0.0173)])
def test_undulation_has_the_rms_of_its_definition(amplitude, rms):
    # The nodes are U(-A/2, A/2), RMS A / sqrt(12); the bilinear surface between them has 2/3 of that.
    nodes = terrain.undulation_nodes(amplitude, BIG, seed=0).heights_m
    assert np.abs(nodes).max() <= amplitude / 2
    assert np.sqrt(np.mean(nodes**2)) == pytest.approx(rms, rel=0.02)
    x, y = np.meshgrid(np.arange(2.0, 38.0, 0.0131), np.arange(2.0, 38.0, 0.171))
    surface = terrain.undulation_nodes(amplitude, BIG, seed=0).height(x, y)
    assert np.sqrt(np.mean(surface**2)) == pytest.approx(2 / 3 * amplitude / math.sqrt(12), rel=0.02)


def test_undulation_is_sampled_exactly_and_level_about_the_start():
    field = terrain.undulation(0.06, (-3.0, 3.0, -3.0, 3.0), 5, start=(1.0, 0.5))
    nodes = terrain.undulation_nodes(0.06, (-3.0, 3.0, -3.0, 3.0), 5)
    assert field.spacing_m <= 0.05
    angles = np.linspace(0.0, math.tau, 100)
    for radius in (0.0, 0.3, 0.5):
        assert not field.height(1.0 + radius * np.cos(angles), 0.5 + radius * np.sin(angles)).any()
    x, y = np.meshgrid(np.arange(-3.0, -0.5, 0.013), np.arange(-3.0, 3.0, 0.11))
    np.testing.assert_allclose(field.height(x, y), nodes.height(x, y), atol=1e-12)


def test_seeds():
    one, again, other = (terrain.undulation(0.06, (-2.0, 2.0, -2.0, 2.0), seed) for seed in (1, 1, 2))
    assert one.heights_m.tobytes() == again.heights_m.tobytes()
    assert one.heights_m.tobytes() != other.heights_m.tobytes()


def test_slope_is_plan_length():
    field = scenario("slope-up-15").terrain(0)
    rise = 4.0 * math.tan(math.radians(15.0))
    np.testing.assert_allclose(field.height([0.0, 1.0, 3.0, 5.0, 6.0], 0.7), [0, 0, rise / 2, rise, rise], atol=1e-9)
    np.testing.assert_allclose(field.normal(2.0, 0.0), (-math.sin(math.pi / 12), 0, math.cos(math.pi / 12)), atol=1e-9)
    assert scenario("slope-down-20").terrain(0).height(5.5, 0.0) == pytest.approx(-4.0 * math.tan(math.radians(20.0)))


def test_s_curve_course_is_level_across_the_path_and_dirty_on_the_arcs_only():
    course = scenario("s-curve")
    field, clean = course.terrain(3), terrain.s_curve_course(terrain.extent_of(s_curve()), 0, dirt_m=0.0)
    path = Polyline(course.waypoints)
    s = np.arange(0.0, path.length, 0.03)
    points = np.array([path.point(v) for v in s])
    heading = np.array([path.heading(v) for v in s])
    profile = np.array(course.profile)
    expected = np.interp(s, profile[:, 0], profile[:, 1])
    for side in (-1.0, -0.5, 0.0, 0.5, 1.0):
        x, y = points[:, 0] - side * np.sin(heading), points[:, 1] + side * np.cos(heading)
        np.testing.assert_allclose(clean.height(x, y), expected, atol=0.02)
        dirt = field.height(x, y) - clean.height(x, y)
        # The arcs bulge into the straights by nothing; 5 cm is the grid.
        straight = (s < 5.95) | ((s > 15.48) & (s < 17.37)) | (s > 26.9)
        assert np.abs(dirt[straight]).max() < 0.004
        assert 0.005 < np.std(dirt[~straight]) < 0.012
    assert abs(np.diff(clean.heights_m, axis=0)).max() < 0.06
    assert abs(np.diff(clean.heights_m, axis=1)).max() < 0.06


@pytest.mark.parametrize("name", ALL)
def test_every_scenario_is_whole(name):
    course = scenario(name)
    field = course.terrain(0)
    x, y, yaw = course.start_pose
    assert field.height(x, y) == 0.0
    assert course.time_limit_s == 1.5 * course.nominal_time_s > 0.0
    if not course.waypoints:
        assert name == "stand"
        return
    points = np.array(course.waypoints)
    x0, x1, y0, y1 = field.extent
    assert (points[:, 0].min() - x0, x1 - points[:, 0].max()) >= (1.5 - 1e-9, 1.5 - 1e-9)
    assert (points[:, 1].min() - y0, y1 - points[:, 1].max()) >= (1.5 - 1e-9, 1.5 - 1e-9)
    path = Polyline(points, course.closed)
    assert (x, y) == course.waypoints[0]
    if name != "turn":
        assert yaw == pytest.approx(path.heading(0.0), abs=0.011)
    assert course.profile[-1][0] == pytest.approx(path.length)
    assert len(points) <= 512


def test_the_papers_figures():
    assert scenario("s-curve").nominal_time_s == pytest.approx(64.0, abs=0.1)
    assert scenario("circle-6cm").nominal_time_s == pytest.approx(10 * math.pi / 0.6, rel=1e-3)
    assert scenario("line-3cm").start_pose == pytest.approx((0.0, 0.0, math.pi / 4))
    assert scenario("slope-up-15").nominal_time_s == pytest.approx((2.0 + 4.0 / math.cos(math.pi / 12)) / 0.5)
    assert scenario("push").push.force_n == pytest.approx(100.0)
    assert scenario("flat").terrain(0).level


@pytest.mark.parametrize("name", ["", "Flat", "slope-up-", "slope-up-0", "slope-down-60", "slope-up-nan", "line-9cm"])
def test_unknown_names_are_told_what_there_is(name):
    with pytest.raises(UnknownScenarioError) as caught:
        scenario(name)
    text = str(caught.value)
    assert repr(name) in text
    assert "\n" not in text
    assert "degrees" in text or "did you mean" in text or all(known in text for known in scenario_names())


def test_variations():
    fast = scenario("flat").with_speed(1.2)
    assert fast.nominal_time_s == pytest.approx(10.0 / 1.2)
    with pytest.raises(ValueError, match="must be positive"):
        scenario("flat").with_speed(math.nan)
    assert scenario("push").with_push(courses.Push(impulse_n_s=15.0)).push.impulse_n_s == 15.0
    own = courses.custom([(1.0, 1.0), (3.0, 1.0)], amplitude_m=0.03)
    assert own.terrain(1).height(1.0, 1.0) == 0.0
    with pytest.raises(PathError):
        courses.custom([(1.0, 1.0)])


@pytest.mark.parametrize(
    "arguments",
    [
        (0.0, 0.0, 0.1, np.zeros((1, 5))),
        (0.0, 0.0, 0.0, np.zeros((3, 3))),
        (0.0, 0.0, 0.1, np.full((3, 3), math.nan)),
        (math.inf, 0.0, 0.1, np.zeros((3, 3))),
    ],
)
def test_impossible_height_fields_are_refused(arguments):
    with pytest.raises(ValueError, match="height field"):
        HeightField(*arguments)


def test_impossible_ground_is_refused():
    with pytest.raises(ValueError, match="slope"):
        terrain.slope(80.0, BIG)
    with pytest.raises(ValueError, match="undulation"):
        terrain.undulation(-0.1, BIG, 0)
