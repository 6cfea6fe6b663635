# SPDX-License-Identifier: Apache-2.0
"""Stance plane, contact by joint torques, and how far a standing foot is trusted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.estimation.contact import loaded_feet, normal_force, rest_deviation
from runtime.estimation.kalman_config import KalmanConfig
from runtime.estimation.stance_plane import FLATNESS, height_above, plane_normal, smoothed
from runtime.models.leg_kinematics import LegKinematics
from runtime.robots import load_configuration

CONFIG = load_configuration("uslgo1")
ROBOT = CONFIG.quadruped
SEEDS = st.integers(0, 2**32 - 1)


def tilted(seed, steepest=0.45):
    rng = np.random.default_rng(seed)
    slope, direction = rng.uniform(0, steepest), rng.uniform(-np.pi, np.pi)
    normal = np.array([np.sin(slope) * np.cos(direction), np.sin(slope) * np.sin(direction), np.cos(slope)])
    xy = np.array([[0.18, 0.12], [0.18, -0.12], [-0.18, 0.12], [-0.18, -0.12]]) + rng.uniform(-0.05, 0.05, (4, 2))
    z = rng.uniform(-1, 1) - xy @ normal[:2] / normal[2]
    return normal, np.column_stack((xy, z))


@given(SEEDS)
def test_the_plane_of_feet_on_a_slope_is_the_slope_but_for_the_ridge(seed):
    normal, feet = tilted(seed)
    found = plane_normal(feet)
    assert np.linalg.norm(found) == pytest.approx(1.0)
    # the ridge shrinks the slopes by FLATNESS / (FLATNESS + spread), spread the least sum of squares
    centered = feet[:, :2] - feet[:, :2].mean(axis=0)
    spread = np.linalg.eigvalsh(centered.T @ centered).min()
    shrink = FLATNESS / (FLATNESS + spread)
    exact, slope = -normal[:2] / normal[2], -found[:2] / found[2]
    assert np.linalg.norm(slope - exact) <= shrink * np.linalg.norm(exact) * 1.0001 + 1e-12
    assert shrink < 0.1


def test_feet_close_together_say_nothing_of_the_slope():
    feet = np.array([(0.0, 0.0, 0.1), (1e-4, 0.0, -0.1), (0.0, 1e-4, 0.0), (1e-4, 1e-4, 0.3)])
    np.testing.assert_allclose(plane_normal(feet), (0, 0, 1), atol=0.05)


@given(SEEDS, st.floats(0.1, 0.4))
def test_height_is_measured_along_the_vertical_from_the_contact_points(seed, height):
    normal, feet = tilted(seed)
    radius = 0.02
    contacts = feet - radius * normal
    level = contacts.mean(axis=0)[2]
    point = np.array([*contacts[:, :2].mean(axis=0), level + height])
    assert height_above(point, feet, normal, radius) == pytest.approx(height, abs=1e-9)
    aside = point + np.array([0.1, -0.2, -(normal[:2] @ (0.1, -0.2)) / normal[2]])
    assert height_above(aside, feet, normal, radius) == pytest.approx(height, abs=1e-9)


@given(SEEDS, SEEDS, st.floats(0.0, 1.0))
def test_smoothing_stays_a_unit_vector_between_the_two(a, b, gain):
    one, other = tilted(a)[0], tilted(b)[0]
    mixed = smoothed(one, other, gain)
    assert np.linalg.norm(mixed) == pytest.approx(1.0)
    assert mixed @ one >= one @ other - 1e-9
    assert mixed @ other >= one @ other - 1e-9


@given(SEEDS)
def test_static_torques_give_back_the_load_of_each_foot(seed):
    rng = np.random.default_rng(seed)
    angles = ROBOT.standing_angles(0.29) + rng.uniform(-0.3, 0.3, 12)
    legs = LegKinematics(ROBOT).forward(angles, np.zeros(12))
    force = rng.uniform(-50, 100, (4, 3))
    torque = -np.einsum("lij,li->lj", legs.jacobian, force).ravel()
    normal = tilted(seed)[0]
    np.testing.assert_allclose(normal_force(legs, torque, normal), force @ normal, atol=1e-3)


def test_a_straight_leg_gives_a_finite_load():
    legs = LegKinematics(ROBOT).forward(np.zeros(12), np.zeros(12))
    assert np.isfinite(normal_force(legs, np.full(12, 5.0), np.array([0.0, 0.0, 1.0]))).all()


@pytest.mark.parametrize(
    ("force", "stance", "progress", "expected"),
    [
        (13.0, True, 0.0, True),
        (11.0, True, 0.5, False),
        (21.0, False, 0.51, True),
        (21.0, False, 0.49, False),
        (19.0, False, 0.9, False),
        (500.0, False, 0.01, False),
    ],
)
def test_contact_is_gated_by_phase(force, stance, progress, expected):
    found = loaded_feet(table_of(KalmanConfig())[0], np.full(4, force), np.full(4, stance), np.full(4, progress))
    assert found.tolist() == [expected] * 4


@given(st.floats(0.0, 1.0))
def test_a_foot_is_trusted_in_the_middle_of_its_stance(progress):
    config = KalmanConfig()
    deviation, mirrored = rest_deviation(table_of(config)[0], np.array([progress, 1.0 - progress]))
    assert config.contact_velocity_mps <= deviation <= config.landing_velocity_mps + 1e-12
    assert deviation == pytest.approx(mirrored)
    if 0.15 <= progress <= 0.85:
        assert deviation == pytest.approx(config.contact_velocity_mps)


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_a_foot_is_not_trusted_as_it_lands_and_lifts(end):
    config = KalmanConfig()
    assert rest_deviation(table_of(config)[0], np.array([end])) == pytest.approx(config.landing_velocity_mps)
