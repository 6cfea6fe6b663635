# SPDX-License-Identifier: Apache-2.0
from itertools import pairwise

import numpy as np
import pytest

from runtime.tracking.errors import PathError
from runtime.tracking.paths import circle, s_curve, straight
from runtime.tracking.polyline import Polyline
from runtime.tracking.sections import SectionedPath, begins_backwards, sections_of, split_at_cusps

ZIGZAG = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.1), (1.0, 0.3), (0.0, 0.3), (1.0, 0.4), (3.0, 0.4)]


def test_splits_where_the_path_turns_back():
    stretches = split_at_cusps(ZIGZAG)
    assert [len(stretch) for stretch in stretches] == [3, 3, 3]
    for before, after in pairwise(stretches):
        assert tuple(before[-1]) == tuple(after[0])
    assert np.vstack([stretches[0], *(stretch[1:] for stretch in stretches[1:])]).tolist() == np.array(ZIGZAG).tolist()


@pytest.mark.parametrize("points", [straight(5.0), s_curve()])
def test_a_path_without_cusps_is_one_section(points):
    assert len(sections_of(points)) == 1
    assert sections_of(points)[0].length == Polyline(points).length


def test_a_closed_path_is_one_section():
    assert [section.closed for section in sections_of(circle(), closed=True)] == [True]
    with pytest.raises(PathError, match="turns back"):
        sections_of(ZIGZAG, closed=True)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([], "no points"),
        ([(0.0, 0.0)], "2 are needed"),
        ([(0.0, 0.0), (1.0, np.nan)], "not a finite number"),
        ([(0.0, 0.0), (1.0, 0.0), (1.0, 0.0)], "repeats"),
        ([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], "shape"),
        ([(0.0, 0.0), (1.0, 0.0), (0.5, 0.0), (2e6, 0.0)], "section 3 of 3, .*beyond"),
    ],
)
def test_what_is_no_path_is_refused(points, message):
    with pytest.raises(PathError, match=message):
        sections_of(points)


def test_backwards_is_where_the_vehicle_points_away():
    section = Polyline(straight(5.0, 0.5))
    assert [begins_backwards(section, yaw) for yaw in (0.5, 2.0, 2.2, 3.6, -1.2)] == [False, False, True, True, True]


def test_one_arc_length_runs_over_all_sections():
    path = SectionedPath([(0.0, 0.0), (2.0, 0.0), (1.0, 0.0), (1.5, 0.0)])
    assert path.length == pytest.approx(3.5)
    assert path.begins == pytest.approx([0.0, 2.0, 3.0])
    assert path.goal == (1.5, 0.0)
    assert [path.point(s)[0] for s in (0.0, 1.5, 2.0, 2.5, 3.0, 3.25, 3.5)] == pytest.approx(
        [0.0, 1.5, 2.0, 1.5, 1.0, 1.25, 1.5]
    )
