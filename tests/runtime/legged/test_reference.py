# SPDX-License-Identifier: Apache-2.0
"""The reference motion against straight lines and circles, on level ground and on slopes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.legged.reference import Demand, Ground, advanced, height_of, reference_states, velocity_along
from runtime.models.rotations import aligned_with_plane, roll_pitch_yaw

LEVEL = Ground(np.array([1.0, -2.0, 0.1]), np.array([0.0, 0.0, 1.0]))
DURATIONS = np.array([0.013, *[0.04] * 9])
ENDS = np.cumsum(DURATIONS)
YAWS, SPEEDS = st.floats(-3.1, 3.1), st.floats(-1.0, 1.0)
COORDINATES = st.floats(-5.0, 5.0)


def slope(steepness, direction):
    flat = math.sin(steepness)
    normal = np.array([flat * math.cos(direction), flat * math.sin(direction), math.cos(steepness)])
    return Ground(np.array([0.3, 0.2, 0.5]), normal)


SLOPES = st.builds(slope, st.floats(0.0, 0.5), YAWS)


def heading(yaw):
    return np.array([math.cos(yaw), math.sin(yaw)])


def at_yaw(yaw, forward, lateral):
    return forward * heading(yaw) + lateral * heading(yaw + 0.5 * math.pi)


@given(YAWS, SPEEDS, SPEEDS)
def test_straight_on_level_ground_it_is_a_constant_velocity(yaw, forward, lateral):
    begin = np.array([0.7, -0.4])
    states = reference_states(begin, yaw, Demand(forward, lateral, 0.0), LEVEL, 0.29, DURATIONS)
    velocity = at_yaw(yaw, forward, lateral)
    assert states.shape == (10, 12)
    np.testing.assert_allclose(states[:, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(states[:, 2], yaw, atol=1e-15)
    np.testing.assert_allclose(states[:, 3:5], begin + np.outer(ENDS, velocity), atol=1e-12)
    np.testing.assert_allclose(states[:, 5], 0.1 + 0.29, atol=1e-12)
    np.testing.assert_array_equal(states[:, 6:9], 0.0)
    np.testing.assert_allclose(states[:, 9:], np.tile([*velocity, 0.0], (10, 1)), atol=1e-12)


@given(YAWS, SPEEDS, SPEEDS, st.floats(0.05, 1.5), st.sampled_from([-1.0, 1.0]))
def test_turning_on_level_ground_it_is_a_circle(yaw, forward, lateral, rate, side):
    rate *= side
    begin = np.array([0.7, -0.4])
    states = reference_states(begin, yaw, Demand(forward, lateral, rate), LEVEL, 0.29, DURATIONS)
    np.testing.assert_allclose(states[:, 2], yaw + rate * ENDS, atol=1e-12)
    np.testing.assert_array_equal(states[:, 8], rate)
    # the integral of a velocity that turns: v / w (sin, 1 - cos)
    turned = [
        at_yaw(yaw, *(forward * np.array([s, c]) + lateral * np.array([-c, s]))) / rate
        for s, c in zip(np.sin(rate * ENDS), 1.0 - np.cos(rate * ENDS), strict=True)
    ]
    # each step goes along its chord, longer than that by (w dt)^2 / 24 of it
    bound = (rate * 0.04) ** 2 / 24 * math.hypot(forward, lateral) * ENDS + 1e-12
    assert (np.linalg.norm(states[:, 3:5] - begin - turned, axis=1) <= bound).all()
    speed = np.linalg.norm(states[:, 9:], axis=1)
    np.testing.assert_allclose(speed, math.hypot(forward, lateral), atol=1e-12)


@given(YAWS, SPEEDS, SPEEDS, st.floats(-1.5, 1.5))
def test_the_velocity_of_a_state_is_the_mean_over_the_step_that_it_ends(yaw, forward, lateral, rate):
    begin = np.array([0.7, -0.4])
    states = reference_states(begin, yaw, Demand(forward, lateral, rate), LEVEL, 0.29, DURATIONS)
    moved = np.diff(np.vstack((begin, states[:, 3:5])), axis=0)
    np.testing.assert_allclose(moved, states[:, 9:11] * DURATIONS[:, None], atol=1e-12)
    for state, middle in zip(states, ENDS - 0.5 * DURATIONS, strict=True):
        np.testing.assert_allclose(state[9:11], at_yaw(yaw + rate * middle, forward, lateral), atol=1e-12)


@given(SLOPES, YAWS, SPEEDS, SPEEDS, st.floats(-1.5, 1.5))
def test_on_a_slope_the_trunk_lies_along_it_and_keeps_its_height(ground, yaw, forward, lateral, rate):
    states = reference_states(np.array([0.7, -0.4]), yaw, Demand(forward, lateral, rate), ground, 0.29, DURATIONS)
    below = states[:, 3:6] - (0.0, 0.0, 0.29)
    np.testing.assert_allclose((below - ground.point) @ ground.normal, 0.0, atol=1e-12)
    np.testing.assert_allclose(states[:, 9:] @ ground.normal, 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(states[:, 5]), states[1:, 11] * DURATIONS[1:], atol=1e-12)
    roll, pitch, _ = roll_pitch_yaw(aligned_with_plane(yaw, ground.normal))
    np.testing.assert_allclose(states[:, :2], np.tile([roll, pitch], (10, 1)), atol=1e-12)


def test_uphill_the_nose_is_up():
    ground = slope(0.2, math.pi)
    states = reference_states(np.zeros(2), 0.0, Demand(0.5, 0.0, 0.0), ground, 0.29, DURATIONS)
    np.testing.assert_allclose(states[:, :3], np.tile([0.0, -0.2, 0.0], (10, 1)), atol=1e-12)
    np.testing.assert_allclose(states[:, 9:], np.tile([0.5 * math.cos(0.2), 0.0, 0.5 * math.sin(0.2)], (10, 1)))


@given(SLOPES, COORDINATES, COORDINATES)
def test_height_of_the_plane(ground, x, y):
    height = height_of(ground, x, y)
    assert (np.array([x, y, height]) - ground.point) @ ground.normal == pytest.approx(0.0, abs=1e-12)


@given(SLOPES, YAWS, SPEEDS, SPEEDS)
def test_the_demanded_velocity_is_along_the_plane_and_of_the_demanded_size(ground, yaw, forward, lateral):
    velocity = velocity_along(aligned_with_plane(yaw, ground.normal), Demand(forward, lateral, 0.3))
    assert velocity @ ground.normal == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(velocity) == pytest.approx(math.hypot(forward, lateral), abs=1e-12)


@given(*[COORDINATES] * 4, SPEEDS, SPEEDS, st.floats(0.001, 0.5))
def test_the_reference_moves_on_and_is_drawn_back_towards_the_robot(x, y, here_x, here_y, vx, vy, clamp):
    reference, present, velocity = np.array([x, y]), np.array([here_x, here_y]), np.array([vx, vy])
    moved, found = reference + 0.02 * velocity, advanced(reference, present, velocity, 0.02, clamp)
    away, distance = moved - present, np.linalg.norm(moved - present)
    if distance <= clamp:
        np.testing.assert_allclose(found, moved, atol=1e-12)
    else:
        np.testing.assert_allclose(found - present, clamp * away / distance, atol=1e-12)


def test_a_reference_at_the_robot_stays_there():
    np.testing.assert_array_equal(advanced(np.ones(2), np.ones(2), np.zeros(2), 0.02, 0.1), np.ones(2))
