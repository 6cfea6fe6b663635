# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.curvature import mean_curvature
from runtime.tracking.errors import PathError
from runtime.tracking.path_csv import read_path_csv
from runtime.tracking.paths import Polyline, check_waypoints, circle, line, s_curve, straight
from runtime.tracking.waypoints import check_cusped_waypoints


def test_s_curve_has_the_plan_length_of_its_parts_and_ends_where_they_lead():
    path = Polyline(s_curve())
    assert path.length == pytest.approx(2 + 4 + 6 * math.pi + 2 + 2.945 + 1.9, abs=5e-3)
    assert path.goal == pytest.approx((8.845, 12.0))
    assert path.point(6.0 + 1.5 * math.pi) == pytest.approx((9.0, 3.0), abs=2e-3)
    assert path.heading(path.length) == pytest.approx(0.0)


def test_circle_starts_at_the_origin_heading_along_x_and_leads_back():
    path = Polyline(circle(5.0), closed=True)
    assert path.length == pytest.approx(10 * math.pi, rel=1e-4)
    assert path.goal == (0.0, 0.0)
    assert path.point(path.length / 4) == pytest.approx((5.0, 5.0), abs=1e-2)
    assert mean_curvature(path, 7.0, path.length / 8) == pytest.approx(0.2, rel=1e-3)
    assert path.point(path.length + 1.0) == pytest.approx(path.point(1.0))


def test_line_and_straight():
    assert Polyline(line()).length == pytest.approx(10 * math.sqrt(2))
    assert Polyline(straight(3.0, math.pi / 2)).goal == pytest.approx((0.0, 3.0))


def test_progress_passes_a_crossing_in_order():
    angles = np.linspace(0.0, 2 * math.pi, 400)
    eight = np.column_stack((4 * np.sin(angles), 2 * np.sin(2 * angles)))
    path = Polyline(eight)
    progress = 0.0
    for s in np.arange(0.0, path.length, 0.02):
        closest = path.closest(*path.point(s), progress, 0.5)
        assert closest.progress == pytest.approx(s, abs=1e-6)
        progress = closest.progress


def test_progress_never_falls():
    path = Polyline(straight(5.0))
    assert path.closest(1.0, 0.2, 2.0, 0.5).progress == 2.0


@given(st.floats(0.0, 6.0), st.floats(-1.0, 1.0))
def test_closest_point_of_a_line_in_closed_form(x, y):
    closest = Polyline(straight(6.0)).closest(x, y, 0.0, 10.0)
    assert closest.progress == pytest.approx(x)
    assert closest.lateral_error == pytest.approx(y)
    assert closest.distance == pytest.approx(abs(y))


@given(st.floats(0.0, 25.0), st.floats(-0.5, 0.5), st.floats(0.6, 2.5))
def test_look_ahead_point_lies_on_the_circle_and_on_the_path(s, offset, distance):
    path = Polyline(circle(5.0), closed=True)
    x, y = path.point(s)
    heading = path.heading(s)
    x, y = x - offset * math.sin(heading), y + offset * math.cos(heading)
    target = path.look_ahead_point(x, y, s, distance)
    assert math.hypot(target[0] - x, target[1] - y) == pytest.approx(distance, rel=1e-9)
    assert math.hypot(target[0], target[1] - 5.0) == pytest.approx(5.0, abs=1e-3)


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
def test_no_place_is_too_far_off(x, y):
    """A damaged log may hold any number."""
    path = Polyline(line())
    assert 0.0 <= path.closest(x, y, 0.0, 5.0).progress <= path.length
    assert math.isfinite(path.look_ahead_progress(x, y, 0.0, 1.0))


def test_look_ahead_goes_on_straight_beyond_the_goal():
    path = Polyline([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
    assert path.look_ahead_point(1.0, 1.8, 2.8, 1.0) == pytest.approx((1.0, 2.8))


def test_look_ahead_from_far_off_the_path_goes_along_it():
    assert Polyline(straight(10.0)).look_ahead_point(2.0, 5.0, 2.0, 1.0) == pytest.approx((3.0, 0.0))


@given(st.floats(0.0, 31.0))
def test_heading_is_continuous(s):
    path = Polyline(s_curve())
    step = 1e-6
    change = math.remainder(path.heading(s + step) - path.heading(s - step), math.tau)
    assert abs(change) < 1e-5


BAD = [
    ([], "no points"),
    ([(0, 0)], "1 point, at least 2"),
    ([(0, 0), (1, math.nan)], "point 2: y is nan"),
    ([(0, 0), (math.inf, 1)], "point 2: x is inf"),
    ([(0, 0), (1e9, 1)], "point 2: x = 1e\\+09 m is beyond"),
    ([(0, 0), (1, 1), (1, 1)], "point 3: \\(1, 1\\) repeats the point before"),
    ([(0, 0), (1, 0), (0.1, 0.1)], "point 2: the path turns back by 174 degrees"),
    ([(0, 0, 0), (1, 0, 0)], "n x 2"),
]


@pytest.mark.parametrize(("points", "message"), BAD)
def test_what_is_not_a_path_is_named_in_one_sentence(points, message):
    with pytest.raises(PathError, match=message) as caught:
        check_waypoints(points)
    assert "\n" not in str(caught.value)


def test_a_closed_path_is_checked_where_it_closes():
    with pytest.raises(PathError, match=r"point 1: .* repeats the last point of a closed path"):
        check_waypoints([(0, 0), (1, 0), (1, 1), (0, 0)], closed=True)
    with pytest.raises(PathError, match="turns back"):
        check_waypoints([(0, 0), (1, 0)], closed=True)


@pytest.mark.parametrize(("points", "message"), [bad for bad in BAD if "turns back" not in bad[1]])
def test_what_may_turn_back_is_refused_for_everything_else(points, message):
    with pytest.raises(PathError, match=message):
        check_cusped_waypoints(points)


def test_only_an_open_path_may_turn_back():
    zigzag = [(0.0, 0.0), (2.0, 0.0), (1.0, 0.1)]
    assert check_cusped_waypoints(zigzag).tolist() == np.array(zigzag).tolist()
    with pytest.raises(PathError, match="point 2: the path turns back by 174 degrees"):
        check_cusped_waypoints(zigzag, closed=True)


def test_capacity():
    with pytest.raises(PathError, match="3 points, at most 2 fit"):
        check_waypoints([(0, 0), (1, 0), (2, 0)], capacity=2)


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_generators_refuse_impossible_lengths(length):
    with pytest.raises(PathError):
        straight(length)
    with pytest.raises(PathError):
        circle(length)


@pytest.mark.parametrize("header", ["", "x,y\n", "X, Y\n", "\ufeffx_m,y_m\n", "# a comment\n\nx,y\n"])
def test_csv_with_and_without_header(tmp_path, header):
    file = tmp_path / "path.csv"
    file.write_text(header + "0,0\n\n1.5, 2e0\r\n3,2\n", encoding="utf-8")
    assert read_path_csv(file).tolist() == [[0.0, 0.0], [1.5, 2.0], [3.0, 2.0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no points"),
        ("x,y\n", "no points"),
        ("x,y\n1,2\n", "1 point, at least 2"),
        ("0,0\nabc,1\n", "row 2: x is 'abc', which is not a number"),
        ("0,0\n1_0,1\n", "row 2: x is '1_0'"),
        ("0,0\n1,\n", "row 2: y is ''"),
        ("0,0\n1,2,3\n", "row 2: has 3 columns"),
        ("0;0\n1;1\n", "row 1: has 1 column, x,y"),
        ("x,y\n0,0\n\n1,nan\n", "row 4: y is nan"),
        ("0,0\n1,1\n1,1\n", "row 3: .* repeats"),
        ("x,y\n0,0\n1,0\n0,0\n", "row 3: the path turns back by 180 degrees"),
        ("0,0\n1,0\n2,0\n3,0\n", "4 points, at most 3"),
    ],
)
def test_malformed_csv_names_file_and_row(tmp_path, text, message):
    file = tmp_path / "path.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(PathError, match=message) as caught:
        read_path_csv(file, capacity=3)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_csv_that_cannot_be_read(tmp_path):
    for file in (tmp_path / "missing.csv", tmp_path, "nul\0byte.csv"):
        with pytest.raises(PathError, match="cannot be read"):
            read_path_csv(file)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"0,0\n\xff\xfe\n")
    with pytest.raises(PathError, match="not UTF-8"):
        read_path_csv(binary)


@given(st.text(max_size=60))
def test_any_text_gives_a_path_or_a_path_error(tmp_path_factory, text):
    file = tmp_path_factory.getbasetemp() / "any.csv"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        assert len(read_path_csv(file)) >= 2
    except PathError as error:
        assert str(error)


def test_a_csv_path_with_a_cusp_is_one_for_who_can_drive_it(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("x,y\n0,0\n2,0\n1,0\n")
    assert read_path_csv(file, check=check_cusped_waypoints).tolist() == [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]]
    with pytest.raises(PathError, match="row 3: the path turns back by 180 degrees"):
        read_path_csv(file)
    file.write_text("x,y\n0,0\n2,0\n2,0\n")
    with pytest.raises(PathError, match=r"row 4: \(2, 0\) repeats the point before"):
        read_path_csv(file, check=check_cusped_waypoints)
