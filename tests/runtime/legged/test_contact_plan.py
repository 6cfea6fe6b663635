# SPDX-License-Identifier: Apache-2.0
"""Which feet will stand where over the horizon."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.legged.contact_plan import contact_points, nominal_centers, stance_schedule
from runtime.legged.gait import GaitConfig, knots
from runtime.legged.reference import Demand, Ground, reference_states
from runtime.robots import load_configuration

MS = 1_000_000
ROBOT = load_configuration("uslgo1").quadruped
SHOULDERS = ROBOT.shoulder_positions()
STEPS, STANCE_S = 10, 0.2
DURATIONS = np.full(STEPS, 0.04)
UP = np.array([0.0, 0.0, 1.0])
FOOTHOLDS = SHOULDERS * (1.0, 1.0, 0.0) + [(0.01, 0.02, 0.02), (-0.03, 0.0, 0.02), (0.0, 0.01, 0.02), (0.02, 0.0, 0.02)]
GAITS = st.builds(GaitConfig, st.integers(20, 100).map(lambda n: n * 10 * MS), st.sampled_from([0.5, 0.6, 0.7, 0.8]))


def moving(yaw=0.0, demand=Demand(0.6, 0.1, 0.4), ground=Ground(np.zeros(3), UP)):  # noqa: B008
    return reference_states(np.array([0.05, -0.02]), yaw, demand, ground, 0.29, DURATIONS)


def schedule(*columns):
    """Stance (N, 4) from four strings, S for standing."""
    return np.array([[letter == "S" for letter in column] for column in columns]).T


def points_of(stance, reference, normal=UP):
    return contact_points(stance, FOOTHOLDS, SHOULDERS, reference, normal, STANCE_S)


def below_shoulder(state, foot):
    """Where the reference motion has the foot's shoulder at mid-stance, seen from above."""
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    x, y, _ = SHOULDERS[foot]
    return state[3:5] + 0.5 * STANCE_S * state[9:11] + (cosine * x - sine * y, sine * x + cosine * y)


def test_feet_that_stand_throughout_stay_where_they_are():
    points = points_of(np.ones((STEPS, 4), dtype=bool), moving())
    np.testing.assert_array_equal(points, np.tile(FOOTHOLDS, (STEPS, 1, 1)))


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_standing_foot_lands_next_below_its_shoulder_at_mid_stance(yaw):
    reference = moving(yaw)
    points = points_of(schedule("SSS...SSSS", *["SSSSSSSSSS"] * 3), reference)
    np.testing.assert_array_equal(points[:6, 0], np.tile(FOOTHOLDS[0], (6, 1)))
    np.testing.assert_allclose(points[6:, 0, :2], np.tile(below_shoulder(reference[6], 0), (4, 1)), atol=1e-12)
    np.testing.assert_allclose(points[6:, 0, 2], 0.02, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_foot_in_the_air_lands_where_it_is_aimed_at_and_only_then_below_its_shoulder(yaw):
    reference = moving(yaw)
    points = points_of(schedule("..SSS...SS", *["SSSSSSSSSS"] * 3), reference)
    np.testing.assert_array_equal(points[:8, 0], np.tile(FOOTHOLDS[0], (8, 1)))
    np.testing.assert_allclose(points[8:, 0, :2], np.tile(below_shoulder(reference[8], 0), (2, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("column", "landing"),
    [
        ("SSSSSSSSSS", None),
        ("..........", None),
        ("SSSSS.....", None),
        (".....SSSSS", None),
        ("SSSSS....S", 9),
        ("S.SSSSSSSS", 2),
        (".S.S.S.S.S", 3),
        (".SSSSSSS.S", 9),
        (".........S", None),
        ("S.S.S.S.S.", 2),
    ],
)
@pytest.mark.parametrize("foot", range(4))
def test_the_first_landing_whose_place_is_open(column, landing, foot):
    columns = ["SSSSSSSSSS"] * 4
    columns[foot] = column
    points = points_of(schedule(*columns), moving())
    known = landing if landing is not None else STEPS
    np.testing.assert_array_equal(points[:known, foot], np.tile(FOOTHOLDS[foot], (known, 1)))
    assert (np.abs(points[known:, foot] - FOOTHOLDS[foot]).max(axis=1) > 1e-3).all()
    others = [other for other in range(4) if other != foot]
    np.testing.assert_array_equal(points[:, others], np.tile(FOOTHOLDS[others], (STEPS, 1, 1)))


@given(st.floats(0.0, 0.4), st.floats(-3.1, 3.1))
def test_landings_are_on_the_plane_of_the_footholds(steepness, direction):
    flat = math.sin(steepness)
    normal = np.array([flat * math.cos(direction), flat * math.sin(direction), math.cos(steepness)])
    reference = moving(ground=Ground(np.zeros(3), normal))
    points = points_of(schedule(*["S..SSSSSSS"] * 4), reference, normal)
    np.testing.assert_allclose((points[3:] - FOOTHOLDS.mean(axis=0)) @ normal, 0.0, atol=1e-12)


@given(GAITS, st.integers(0, 10**9), st.integers(0, 10**9))
def test_the_schedule_is_the_gaits_over_each_step(gait, start_ns, wait_ns):
    boundaries = knots(table_of(gait)[0], start_ns, start_ns + wait_ns, STEPS)
    stance = stance_schedule(table_of(gait)[0], start_ns, boundaries)
    assert stance.shape == (STEPS, 4)
    for step in range(STEPS):
        begin, end = boundaries[step], boundaries[step + 1]
        for foot, offset in enumerate((0.0, 0.5, 0.5, 0.0)):
            # tenths of the cycle are the gait's grid: a step lies wholly in a stance or a swing
            phase = (((begin + end) / 2 - start_ns) / gait.period_ns + offset) % 1.0
            assert stance[step, foot] == (phase < gait.stance_fraction)
    np.testing.assert_array_equal(stance[:, 0], stance[:, 3])
    np.testing.assert_array_equal(stance[:, 1], stance[:, 2])
    assert stance.any(axis=1).all()


def test_a_robot_on_its_reference_stays_on_it():
    reference = moving(demand=Demand(0.6, 0.1, 0.0))
    begin = np.array([0.05, -0.02, 0.29])
    middles = begin + np.outer(np.cumsum(DURATIONS) - 0.5 * DURATIONS, reference[0, 9:])
    np.testing.assert_allclose(nominal_centers(begin, reference, DURATIONS), middles, atol=1e-12)


def test_a_robot_beside_its_reference_catches_up_over_the_horizon():
    reference = moving()
    begin, away = np.array([0.05, -0.02, 0.29]), np.array([0.04, -0.06, -0.02])
    gained = nominal_centers(begin + away, reference, DURATIONS) - nominal_centers(begin, reference, DURATIONS)
    np.testing.assert_allclose(gained[0], away, atol=1e-12)
    np.testing.assert_allclose(gained[-1], away / STEPS, atol=1e-12)
    np.testing.assert_allclose(np.diff(gained, axis=0), np.tile(-away / STEPS, (STEPS - 1, 1)), atol=1e-12)


def test_on_a_slope_too_a_landing_is_vertically_below_its_shoulder():
    """As GaitTask places the feet, and as the trunk's weight has it."""
    normal = np.array([-math.sin(0.3), 0.0, math.cos(0.3)])
    reference = moving(demand=Demand(0.0, 0.0, 0.0), ground=Ground(np.zeros(3), normal))
    points = points_of(schedule(*["S..SSSSSSS"] * 4), reference, normal)
    wanted = [below_shoulder(reference[3], foot) for foot in range(4)]
    np.testing.assert_allclose(points[3, :, :2], wanted, atol=0.005)
