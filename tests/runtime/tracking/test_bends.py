# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from runtime.tracking.bends import CURVES, Bend, arc, figure_eight, path_of_bends, path_of_strokes
from runtime.tracking.curvature import mean_curvature
from runtime.tracking.errors import PathError
from runtime.tracking.polyline import Polyline
from runtime.tracking.sections import SectionedPath


@pytest.mark.parametrize("name", sorted(CURVES))
def test_courses_are_forty_metres_and_bend_no_more_than_they_say(name):
    points = CURVES[name]()
    line = Polyline(points)
    assert line.length == pytest.approx(40.0, abs=0.02)
    assert tuple(points[0]) == (0.0, 0.0)
    assert line.heading(1.0) == pytest.approx(0.0)
    bends = [abs(mean_curvature(line, s, 0.6)) for s in np.arange(0.0, 40.0, 0.05)]
    assert max(bends) == pytest.approx(0.4, abs=0.005)
    spacings = np.hypot(*np.diff(points, axis=0).T)
    assert spacings == pytest.approx([0.3] * len(spacings), abs=0.002)


@pytest.mark.parametrize(
    ("name", "degrees"), [("u", 180.0), ("s", 0.0), ("right-angle", 90.0), ("loop", -90.0), ("chicane", 0.0)]
)
def test_courses_end_in_their_direction(name, degrees):
    line = Polyline(CURVES[name]())
    assert math.cos(line.heading(39.5) - math.radians(degrees)) == pytest.approx(1.0)


def test_the_loop_crosses_itself():
    points = CURVES["loop"]()
    way_in, way_out = points[:40], points[-60:]
    gaps = np.hypot(*(way_in[:, None] - way_out[None]).T)
    assert gaps.min() < 0.3


def test_arc_is_exact():
    points = path_of_bends((arc(-90.0, 2.0),))
    assert points[-1] == pytest.approx((2.0, -2.0))
    assert np.hypot(points[:, 0], points[:, 1] + 2.0) == pytest.approx([2.0] * len(points))


def test_figure_eight():
    points = figure_eight()
    line = Polyline(points, closed=True)
    assert line.length == pytest.approx(5.2441 * 8.0, abs=0.02)
    squares = points[:, 0] ** 2 + points[:, 1] ** 2
    assert squares**2 == pytest.approx(64.0 * (points[:, 0] ** 2 - points[:, 1] ** 2), abs=0.05)
    bends = [abs(mean_curvature(line, s, 0.6)) for s in np.arange(1.0, 41.0, 0.05)]
    assert max(bends) == pytest.approx(1.0 / 2.67, abs=0.01)
    assert line.heading(0.2) == pytest.approx(math.radians(45.0), abs=0.05)


@pytest.mark.parametrize("bend", [Bend(0.0), Bend(-1.0), Bend(math.nan), Bend(1.0, math.inf)])
def test_degenerate_stretches_are_refused(bend):
    with pytest.raises(PathError, match="is no stretch"):
        path_of_bends((bend,))


@pytest.mark.parametrize("spacing", [0.0, -1.0, math.nan])
def test_degenerate_spacings_are_refused(spacing):
    with pytest.raises(PathError, match="spacing"):
        path_of_bends((Bend(1.0),), spacing)
    with pytest.raises(PathError, match="figure-eight"):
        figure_eight(8.0, spacing)


def test_strokes_go_the_opposite_way_each_from_where_the_one_before_ends():
    quarter = arc(90.0, 2.0)
    path = SectionedPath(path_of_strokes(((Bend(1.0), quarter), (Bend(3.0),), (quarter,)), spacing_m=0.05))
    assert [section.length for section in path.sections] == pytest.approx([1.0 + math.pi, 3.0, math.pi], abs=1e-3)
    assert path.point(path.begins[1]) == pytest.approx((3.0, 2.0))
    assert path.point(path.begins[2]) == pytest.approx((3.0, -1.0))
    assert path.goal == pytest.approx((1.0, 1.0))
    assert [math.degrees(section.heading(0.0)) for section in path.sections] == pytest.approx(
        [0.0, -90.0, 90.7], abs=0.1
    )
