# SPDX-License-Identifier: Apache-2.0
"""Feet land below their shoulders at mid-stance, further where the robot was pushed, and never out of reach."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.legged.footholds import FootholdConfig, TrunkMotion, foothold

SHOULDERS = np.array([[0.18, 0.122], [0.18, -0.122], [-0.18, 0.122], [-0.18, -0.122]])
CONFIG = FootholdConfig(capture_gain=0.7, reach_m=0.28)
SPEEDS = st.floats(-3.0, 3.0)
STANCE_S, HEIGHT, G = 0.2, 0.29, 9.81


def land(velocity=(0.0, 0.0), commanded=(0.0, 0.0), yaw_rate=0.0, center=(0.0, 0.0), remaining=0.1, heading=0.0):
    """Footholds of the four feet, (4, 2)."""
    trunk = TrunkMotion(*center, heading, *velocity, *commanded, yaw_rate, HEIGHT)
    return np.array([foothold(table_of(CONFIG)[0], trunk, (x, y), remaining, STANCE_S) for x, y in SHOULDERS.tolist()])


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(0.0, 0.5))
def test_a_robot_at_rest_steps_below_its_shoulders(x, y, remaining):
    np.testing.assert_allclose(land(center=(x, y), remaining=remaining), SHOULDERS + np.array([x, y]), atol=1e-12)


@given(SPEEDS, SPEEDS, st.floats(0.0, 0.3))
def test_at_the_commanded_speed_the_foot_is_below_its_shoulder_at_mid_stance(vx, vy, remaining):
    if np.hypot(vx, vy) * 0.5 * STANCE_S > CONFIG.reach_m:
        return
    expected = SHOULDERS + np.array([vx, vy]) * (remaining + 0.5 * STANCE_S)
    np.testing.assert_allclose(land((vx, vy), (vx, vy), remaining=remaining), expected, atol=1e-12)


def test_too_fast_by_some_speed_it_steps_further_by_the_capture_term():
    extra = land((0.3, -0.1), (0.0, 0.0), remaining=0.0) - land()
    np.testing.assert_allclose(extra, np.tile(0.7 * np.sqrt(HEIGHT / G) * np.array([0.3, -0.1]), (4, 1)), atol=1e-12)


@given(SPEEDS, SPEEDS, SPEEDS, SPEEDS, st.floats(0.0, 0.3))
def test_no_step_exceeds_the_reach(vx, vy, cx, cy, remaining):
    points = land((vx, vy), (cx, cy), remaining=remaining)
    below = SHOULDERS + remaining * np.array([vx, vy])
    assert (np.hypot(*(points - below).T) <= CONFIG.reach_m + 1e-12).all()


@given(SPEEDS, SPEEDS, st.floats(-1.0, 1.0), st.floats(0.0, 0.3))
def test_mirrored_commands_give_mirrored_footholds(vx, vy, yaw_rate, remaining):
    one = land((vx, vy), (0.5 * vx, vy), yaw_rate, remaining=remaining)
    other = land((vx, -vy), (0.5 * vx, -vy), -yaw_rate, remaining=remaining)
    np.testing.assert_allclose(other[[1, 0, 3, 2]] * (1, -1), one, atol=1e-12)


def test_turning_in_place_the_feet_step_along_their_circle():
    rate, remaining = 0.5, 0.1
    points = land(yaw_rate=rate, remaining=remaining)
    turn = rate * (remaining + 0.5 * STANCE_S)
    exact = SHOULDERS @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    # first order in the angle of 0.1 rad
    np.testing.assert_allclose(points, exact, atol=0.5 * turn**2 * 0.22)
    assert np.hypot(*(points - SHOULDERS).T).min() == pytest.approx(turn * 0.2175, rel=0.01)


@given(st.floats(-3.1, 3.1), SPEEDS, SPEEDS, st.floats(-1.0, 1.0))
def test_a_turned_robot_steps_the_same_in_its_own_frame(heading, vx, vy, yaw_rate):
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    one = land((vx, vy), (0.5 * vx, 0.0), yaw_rate)
    other = land(turn @ (vx, vy), turn @ (0.5 * vx, 0.0), yaw_rate, heading=heading)
    np.testing.assert_allclose(other, one @ turn.T, atol=1e-12)
