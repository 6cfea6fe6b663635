# SPDX-License-Identifier: Apache-2.0
import json
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.recording.metrics import (
    errors,
    first_motion,
    mean_speed,
    path_metrics,
    project,
    surface_length,
    tracking_error,
)
from runtime.tracking.paths import Polyline, circle, straight
from runtime.tracking.sections import SectionedPath

TEN_METRES = Polyline(straight(10.0))


def walk(path, speed=0.5, offset=0.0, wait=1.0, hold=1.0, step=0.01, yaw_offset=0.0):
    """Stand, walk beside the path at constant speed, stand at the goal."""
    t = np.arange(0.0, wait + path.length / speed + hold, step)
    s = np.clip((t - wait) * speed, 0.0, path.length)
    heading = np.array([path.heading(v) for v in s])
    points = np.array([path.point(v) for v in s])
    xy = points + offset * np.column_stack((-np.sin(heading), np.cos(heading)))
    return t, xy, heading + yaw_offset


def test_a_walk_beside_a_line_in_closed_form():
    result = path_metrics(*walk(TEN_METRES, offset=-0.04, yaw_offset=0.1), TEN_METRES, 30.0)
    assert result.completed
    assert result.first_motion_s == pytest.approx(1.04, abs=0.02)
    assert result.lateral_error_m.mean == pytest.approx(0.04)
    assert result.lateral_error_m.rms == pytest.approx(0.04)
    assert result.lateral_error_m.max == pytest.approx(0.04)
    assert result.lateral_error_m.std == pytest.approx(0.0, abs=1e-6)
    assert result.heading_error_rad.rms == pytest.approx(0.1)
    assert result.tracking_error_mean_m == pytest.approx(0.04)
    assert result.speed_mean_mps == pytest.approx(0.5, rel=1e-6)
    assert result.path_length_m == pytest.approx(10.0)
    assert result.completion_time_s == pytest.approx(20.0, abs=0.1)


@settings(max_examples=10, deadline=None)
@given(st.floats(-0.14, 0.14))
def test_an_offset_circle(offset):
    path = Polyline(circle(5.0), closed=True)
    t, xy, yaw = walk(path, offset=offset, speed=1.0, step=0.02)
    result = path_metrics(t, xy, yaw, path, 100.0)
    assert result.lateral_error_m.mean == pytest.approx(abs(offset), abs=1e-3)
    assert result.heading_error_rad.max < 0.03
    assert result.completed
    assert result.completion_time_s == pytest.approx(10 * math.pi, abs=0.3)
    seen = project(xy[:, 0], xy[:, 1], yaw, path)
    np.testing.assert_allclose(seen.lateral_error[:-200], offset, atol=1e-3)


def test_the_start_of_a_lap_is_not_its_end():
    path = Polyline(circle(5.0), closed=True)
    t = np.arange(0.0, 5.0, 0.01)
    wobble = np.column_stack((0.04 * np.sin(t), 0.0 * t))
    result = path_metrics(t, wobble, 0.0 * t, path, 100.0)
    assert not result.completed
    assert math.isnan(result.completion_time_s)


def test_arc_length_only_grows():
    x = np.array([0.0, 0.4, 0.8, 0.3, 1.0])
    seen = project(x, 0.0 * x, 0.0 * x, TEN_METRES)
    assert seen.progress == pytest.approx([0.0, 0.4, 0.8, 0.8, 1.0])
    assert seen.distance == pytest.approx([0.0, 0.0, 0.0, 0.5, 0.0])


def test_sinusoidal_error_has_its_rms():
    t = np.linspace(0.0, 10.0, 10_001)
    result = errors(t, 0.03 * np.sin(2 * math.pi * t))
    assert result.rms == pytest.approx(0.03 / math.sqrt(2), rel=1e-3)
    assert result.mean == pytest.approx(0.03 * 2 / math.pi, rel=1e-3)
    assert result.max == pytest.approx(0.03)
    assert result.std == pytest.approx(math.sqrt(result.rms**2 - result.mean**2))


def test_the_average_is_over_time_not_over_samples():
    t = np.concatenate((np.linspace(0.0, 1.0, 1001), [2.0]))
    assert errors(t, np.where(t < 1.0, 0.0, 1.0)).mean == pytest.approx(0.5, abs=1e-3)


@given(st.lists(st.floats(0.0, 10.0), min_size=2, max_size=50))
def test_eq_46_and_47(values):
    sample = np.array(values)
    mean, std = tracking_error(sample)
    assert mean == pytest.approx(sample.sum() / len(sample))
    assert std == pytest.approx(np.std(sample, ddof=1), abs=1e-9)


def test_speed_is_along_the_surface_where_its_profile_is_given():
    angle = math.radians(20.0)
    profile = [(0.0, 0.0), (3.0, 0.0), (7.0, 4.0 * math.tan(angle)), (10.0, 4.0 * math.tan(angle))]
    assert surface_length(7.0, profile) == pytest.approx(3.0 + 4.0 / math.cos(angle))
    t = np.linspace(0.0, 30.0, 3001)
    surface = 0.5 * t
    s = np.interp(surface, surface_length([0, 3, 7, 10], profile), [0, 3, 7, 10])
    assert mean_speed(t, s, 10.0, profile) == pytest.approx(0.5, rel=1e-3)
    assert mean_speed(t, s, 10.0) < 0.5


def test_speed_leaves_out_the_first_and_the_last_metre():
    t = np.array([0.0, 10.0, 12.0, 30.0])
    assert mean_speed(t, np.array([0.0, 1.0, 9.0, 10.0]), 10.0) == pytest.approx(4.0)
    assert math.isnan(mean_speed(t, np.array([0.0, 1.0, 5.0, 6.0]), 10.0))
    assert math.isnan(mean_speed(t, t, 2.0))


def test_too_late_is_not_completed():
    result = path_metrics(*walk(TEN_METRES), TEN_METRES, 19.0)
    assert not result.completed
    assert result.completion_time_s > 19.0


def test_passing_the_goal_is_not_stopping_there():
    t = np.arange(0.0, 30.0, 0.01)
    xy = np.column_stack((0.5 * t, 0.0 * t))
    assert not path_metrics(t, xy, 0.0 * t, TEN_METRES, 40.0).completed


def test_stopping_too_far_off_is_not_completed():
    assert not path_metrics(*walk(TEN_METRES, offset=0.2), TEN_METRES, 40.0).completed


def test_standing_still_is_reported_without_a_number_and_as_json():
    t = np.arange(0.0, 1.0, 0.01)
    result = path_metrics(t, np.zeros((100, 2)), 0.0 * t, TEN_METRES, 30.0)
    assert first_motion(0.0 * t, 0.0 * t) is None
    assert not result.completed
    summary = json.loads(json.dumps(result.summary(0.6), allow_nan=False))
    assert summary["completion_time_s"] is None
    assert summary["speed_mps"] == {"mean": None, "commanded": 0.6}
    assert set(summary["lateral_error_m"]) == {"mean", "rms", "max", "std"}


def test_yaw_is_unwrapped():
    path = Polyline(straight(3.0, math.pi))
    t, xy, yaw = walk(path)
    result = path_metrics(t, xy, np.where(np.arange(len(t)) % 2, yaw, yaw - math.tau), path, 30.0)
    assert result.heading_error_rad.max == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("shape", [(0, 0, 0), (5, 4, 5), (5, 5, 4)])
def test_arrays_that_do_not_fit_are_refused(shape):
    a, b, c = shape
    with pytest.raises(ValueError, match="metrics"):
        path_metrics(np.arange(a), np.zeros((b, 2)), np.zeros(c), TEN_METRES, 1.0)


def zigzag(overshoot=0.0, offset=0.0):
    """Two metres there, a metre and a half back and one there again, at 0.5 m/s, beyond each cusp by an overshoot.

    Times, positions and yaws; standing for a second at each turn and at the end.
    """
    turns = [0.0, 2.0 + overshoot, 0.5 - overshoot, 1.5]
    x = [np.zeros(10)]
    for begin, end in pairwise(turns):
        x += [np.linspace(begin, end, round(abs(end - begin) / 0.005)), np.full(100, end)]
    x = np.concatenate(x)
    t = 0.01 * np.arange(len(x))
    return t, np.column_stack((x, np.full(len(x), offset))), np.zeros(len(x))


CUSPED = SectionedPath([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (1.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.5, 0.0)])


@pytest.mark.parametrize("overshoot", [-0.05, 0.0, 0.05])
def test_a_path_with_cusps_is_judged_section_by_section(overshoot):
    t, xy, yaw = zigzag(overshoot, offset=0.02)
    seen = project(xy[:, 0], xy[:, 1], yaw, CUSPED)
    assert (np.diff(seen.progress) >= 0.0).all()
    assert seen.progress[-1] == pytest.approx(4.5)
    assert seen.distance.max() == pytest.approx(math.hypot(0.02, max(overshoot, 0.0)), abs=1e-3)
    assert seen.lateral_error[[100, 600]] == pytest.approx((0.02, -0.02))
    np.testing.assert_allclose(seen.heading_error, 0.0, atol=1e-12)
    result = path_metrics(t, xy, yaw, CUSPED, 20.0)
    assert result.completed
    assert result.path_length_m == pytest.approx(4.5)
    assert result.lateral_error_m.mean == pytest.approx(0.02, abs=0.02)


def test_who_stays_at_a_cusp_or_passes_the_goal_before_is_not_done():
    t, xy, yaw = zigzag()
    first = slice(0, 10 + 400 + 100)
    assert not path_metrics(t[first], xy[first], yaw[first], CUSPED, 20.0).completed
    seen = project(*xy[first].T, yaw[first], CUSPED)
    assert seen.progress[-1] == pytest.approx(2.0)
    assert seen.progress[10 + 300] == pytest.approx(1.5, abs=0.01)  # abreast of the goal, two sections before it


def test_a_push_against_the_way_is_no_turn():
    """Where a section ends only near its end; a vehicle that is held up before is still on it."""
    x = np.concatenate((np.linspace(0.0, 1.0, 200), np.linspace(1.0, 0.8, 40), np.linspace(0.8, 2.0, 240)))
    seen = project(x, 0.0 * x, 0.0 * x, CUSPED)
    assert seen.progress[-1] == pytest.approx(2.0)
    assert seen.progress[239] == pytest.approx(1.0)
