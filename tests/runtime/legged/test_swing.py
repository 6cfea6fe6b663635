# SPDX-License-Identifier: Apache-2.0
"""The path of a foot in the air is smooth, starts and ends where it should, and searches for late ground."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.legged.swing import SwingConfig, foot_reference

SEEDS = st.integers(0, 2**32 - 1)
DURATION = 0.2
CONFIG = SwingConfig(height_m=0.08, touchdown_speed_mps=0.2, search_speed_mps=0.5, reach_below_m=0.06)


def case(seed):
    """A lift-off, a foothold and a normal up to 25 degrees from vertical."""
    rng = np.random.default_rng(seed)
    slope, direction = rng.uniform(0.0, 0.43), rng.uniform(-np.pi, np.pi)
    normal = np.array([np.sin(slope) * np.cos(direction), np.sin(slope) * np.sin(direction), np.cos(slope)])
    lift_off = rng.uniform(-1, 1, 3)
    return lift_off, lift_off + rng.uniform(-0.3, 0.3, 3) * (1, 1, 0.3), normal


def reference(seed, progress):
    """Position, velocity, acceleration, (3, 3)."""
    return reference_of(*case(seed), progress)


def reference_of(lift_off, foothold, normal, progress):
    return np.array(foot_reference(table_of(CONFIG)[0], lift_off, foothold, normal, progress, DURATION))


@given(SEEDS)
def test_it_begins_at_rest_at_lift_off(seed):
    position, velocity, acceleration = reference(seed, 0.0)
    np.testing.assert_allclose(position, case(seed)[0], atol=1e-12)
    np.testing.assert_allclose([*velocity, *acceleration], 0.0, atol=1e-9)


@given(SEEDS)
def test_it_comes_down_on_the_foothold_at_the_touchdown_speed(seed):
    _, foothold, normal = case(seed)
    position, velocity, _ = reference(seed, 1.0 - 1e-9)
    np.testing.assert_allclose(position, foothold, atol=1e-7)
    np.testing.assert_allclose(velocity, -0.2 * normal, atol=1e-5)


@given(SEEDS, st.floats(0.02, 0.97))
def test_velocity_and_acceleration_are_derivatives(seed, progress):
    step = 1e-5
    if abs(progress - 0.5) < 2 * step:
        return
    _, velocity, acceleration = reference(seed, progress)
    ahead, behind = reference(seed, progress + step), reference(seed, progress - step)
    np.testing.assert_allclose(velocity, (ahead[0] - behind[0]) / (2 * step * DURATION), atol=1e-5)
    np.testing.assert_allclose(acceleration, (ahead[1] - behind[1]) / (2 * step * DURATION), atol=1e-3)


@given(SEEDS)
def test_position_and_velocity_do_not_jump_at_mid_swing(seed):
    before, after = reference(seed, 0.5 - 1e-9), reference(seed, 0.5)
    np.testing.assert_allclose(before[0], after[0], atol=1e-7)
    np.testing.assert_allclose(before[1], after[1], atol=1e-5)


@given(SEEDS)
def test_the_apex_clears_both_ends_by_the_height(seed):
    lift_off, foothold, normal = case(seed)
    heights = [float((reference(seed, s)[0] - lift_off) @ normal) for s in np.linspace(0, 1, 41)]
    expected = max(0.0, float((foothold - lift_off) @ normal)) + CONFIG.height_m
    assert max(heights) == pytest.approx(expected, abs=1e-6)
    assert np.argmax(heights) == 20


@given(SEEDS, st.floats(1.0, 5.0))
def test_where_the_ground_comes_late_the_foot_goes_on_down_to_its_reach(seed, progress):
    _, foothold, normal = case(seed)
    position, velocity, acceleration = reference(seed, progress)
    depth = min(0.5 * (progress - 1.0) * DURATION, 0.06)
    np.testing.assert_allclose(position, foothold - depth * normal, atol=1e-12)
    np.testing.assert_allclose(velocity, -normal * (0.5 if depth < 0.06 else 0.0), atol=1e-12)
    assert not acceleration.any()


def test_it_swings_the_same_to_either_side():
    lift_off, foothold, normal = case(3)
    mirror = np.array([1.0, -1.0, 1.0])
    for progress in (0.1, 0.4, 0.7, 1.3):
        one = reference_of(lift_off, foothold, normal, progress)
        other = reference_of(lift_off * mirror, foothold * mirror, normal * mirror, progress)
        np.testing.assert_allclose(other, one * mirror, atol=1e-12)
