# SPDX-License-Identifier: Apache-2.0
"""The choice of the pursued point, and paper 002's straight-line experiment on a kinematic vehicle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.longitudinal import pursued_progress, pursued_waypoint
from runtime.tracking.motion import Motion
from runtime.tracking.paths import circle
from runtime.tracking.polyline import Polyline
from runtime.tracking.waypoint_pursuit import WaypointPursuit

LINE = np.column_stack((np.arange(0.0, 25.1, 0.3), np.zeros(84)))
PATH = Polyline(LINE)
PLAIN = WaypointPursuit()

offsets = st.floats(-4.0, 4.0)
gains = st.floats(0.0, 2.0)


def closest(x, y, path=PATH, start=0.0):
    return path.closest(x, y, start, 10.0)


@given(st.floats(0.0, 6.0), offsets, gains, st.floats(0.5, 2.0))
def test_both_constraints_hold_and_no_earlier_point_meets_them(x, y, gain, look_ahead):
    near = closest(x, y)
    s = pursued_progress(PATH, x, y, near, look_ahead, gain)
    longitudinal = s - near.progress
    assert math.hypot(longitudinal, y) >= look_ahead - 1e-6
    assert longitudinal >= gain * abs(y) - 1e-6
    if abs(y) < look_ahead - 1e-3:
        least = max(math.sqrt(look_ahead**2 - y * y), gain * abs(y))
    else:
        least = max(look_ahead, gain * abs(y))
    assert longitudinal <= least + 0.1


@given(st.floats(0.0, 6.0), offsets, gains, st.floats(0.5, 2.0))
def test_a_waypoint_is_at_most_one_spacing_further(x, y, gain, look_ahead):
    near = closest(x, y)
    s = pursued_waypoint(PATH, x, y, near, look_ahead, gain, 0.3)
    assert s / 0.3 == pytest.approx(round(s / 0.3), abs=1e-9)
    px, py = PATH.point(s)
    assert math.hypot(px - x, py - y) >= look_ahead - 1e-6
    assert s - near.progress <= pursued_progress(PATH, x, y, near, look_ahead, gain) - near.progress + 0.451


def test_at_the_look_ahead_distance_the_circle_touches_the_waypoint_beside():
    """The paper's start: 1.5 m beside, L_a = 1.5 m gives R = 0.75 m and its Table II's 56.9 degrees."""
    pursuit = PLAIN(PATH, Motion(3.0, -1.5, 0.0), closest(3.0, -1.5))
    assert pursuit.target == pytest.approx((3.0, 0.0))
    assert pursuit.curvature == pytest.approx(1.0 / 0.75)


def test_out_of_reach_the_path_is_met_further_on():
    pursuit = PLAIN(PATH, Motion(3.0, -2.5, 0.0), closest(3.0, -2.5))
    assert pursuit.target == pytest.approx((4.5, 0.0))


@pytest.mark.parametrize(("gain", "longitudinal"), [(0.6, 0.9), (0.9, 1.5), (1.2, 1.8)])
def test_the_constraint_takes_the_first_waypoint_far_enough_from_the_nearest(gain, longitudinal):
    pursuit = WaypointPursuit(longitudinal_gain=gain)(PATH, Motion(3.0, -1.5, 0.0), closest(3.0, -1.5))
    assert pursuit.target == pytest.approx((3.0 + longitudinal, 0.0))


def test_a_path_that_stays_within_the_look_ahead_distance_is_taken_as_it_is():
    ring = Polyline(circle(0.4), closed=True)
    near = ring.closest(0.0, 0.4, 0.0, 1.0)
    assert math.isfinite(pursued_waypoint(ring, 0.0, 0.4, near, 1.5, 0.9, 0.1))
    assert math.isfinite(pursued_progress(ring, 0.0, 0.4, near, 1.5, 0.9))


# mean error, m, overshoot, m, and settling time, s, for K_r = 0 (plain), 0.6, 0.9 and 1.2
LATE_POSE = {0.0: (0.258, 0.64, 11.9), 0.6: (0.219, 0.33, 9.0), 0.9: (0.209, 0.09, 8.5), 1.2: (0.225, 0.06, 8.6)}
LATE_COMMAND = {0.0: (0.297, 0.67, 12.5), 0.6: (0.261, 0.40, 9.7), 0.9: (0.245, 0.09, 9.3), 1.2: (0.261, 0.06, 9.6)}


def straight(bicycle, follower, gain, **delays):
    controller = follower(WaypointPursuit(longitudinal_gain=gain), LINE, 0.6)
    return bicycle(LINE, controller, start=(0.0, -1.5, 0.0), speed=0.6, **delays).run(25.0)


@pytest.mark.parametrize("gain", [0.0, 0.6, 0.9, 1.2])
@pytest.mark.parametrize(
    ("delays", "table"), [({"pose_delay_s": 0.6}, LATE_POSE), ({"command_delay_s": 0.6}, LATE_COMMAND)]
)
def test_straight_line_with_delay(bicycle, follower, gain, delays, table):
    drive = straight(bicycle, follower, gain, **delays)
    mean, overshoot, settling = table[gain]
    assert drive.mean_error() == pytest.approx(mean, abs=0.004)
    assert drive.overshoot() == pytest.approx(overshoot, abs=0.02)
    assert drive.settling_time() == pytest.approx(settling, abs=0.35)


def test_with_delay_the_papers_order_holds_and_without_it_reverses(bicycle, follower):
    late = [straight(bicycle, follower, gain, command_delay_s=0.6).mean_error() for gain in (0.9, 0.6, 0.0)]
    ideal = [straight(bicycle, follower, gain).mean_error() for gain in (0.0, 0.6, 0.9)]
    assert late == sorted(late)
    assert ideal == sorted(ideal)
