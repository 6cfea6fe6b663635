# SPDX-License-Identifier: Apache-2.0
"""What is counted on of the ground falls while the vehicle slides, and comes back slowly; noise changes little."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.bends import figure_eight
from runtime.tracking.path_speed import PathSpeed
from runtime.tracking.paths import Polyline
from runtime.tracking.speed import SpeedLimits
from runtime.tracking.traction import TractionConfig, next_lost, slides
from runtime.tracking.vehicle_answer import VehicleAnswer

CONFIG = TractionConfig()
ROLLING = (0.0, 0.0, 0.0, 0.0)
STEP_S = 0.02


@pytest.mark.parametrize(
    ("velocity", "slip", "asked_mps2", "sliding"),
    [
        ((3.0, 0.0), ROLLING, 2.0, False),
        ((3.0, 0.055), ROLLING, 2.0, False),
        ((3.0, -0.065), ROLLING, 2.0, True),
        ((3.0, -0.065), ROLLING, 0.4, False),
        ((-3.0, 0.065), ROLLING, -2.0, True),
        ((0.5, 0.045), ROLLING, 1.0, False),
        ((0.5, 0.055), ROLLING, 1.0, True),
        ((3.0, 0.0), (0.9, 0.0, 0.0, 0.0), 2.0, False),
        ((3.0, 0.0), (0.0, 0.2, 0.0, -0.2), 0.0, True),
        ((0.1, 0.0), (1.0, 1.0, 1.0, 1.0), 0.0, False),
        ((math.nan, math.nan), ROLLING, 2.0, False),
    ],
)
def test_what_counts_as_sliding(velocity, slip, asked_mps2, sliding):
    """Across, beyond a speed and a share of it, while the ground is asked for something; along, two wheels at least."""
    assert slides(velocity, slip, asked_mps2, CONFIG) == sliding


def test_it_falls_to_its_least_and_comes_back_slowly():
    lost, falls_s, rises_s = 0.0, 0.0, 0.0
    while lost < 1.0 - CONFIG.least:
        lost, falls_s = next_lost(lost, True, STEP_S, CONFIG), falls_s + STEP_S
    assert lost == 1.0 - CONFIG.least
    while lost > 0.0:
        lost, rises_s = next_lost(lost, False, STEP_S, CONFIG), rises_s + STEP_S
    assert falls_s == pytest.approx((1.0 - CONFIG.least) / CONFIG.fall_per_s, abs=1.1 * STEP_S)
    assert rises_s == pytest.approx((1.0 - CONFIG.least) / CONFIG.rise_per_s, abs=1.1 * STEP_S)


@given(st.floats(0.0, 1.0 - CONFIG.least), st.booleans(), st.floats(0.0, 1.0))
def test_it_stays_within_its_bounds(lost, sliding, dt):
    after = next_lost(lost, sliding, dt, CONFIG)
    assert 0.0 <= after <= 1.0 - CONFIG.least
    assert after >= lost if sliding else after <= lost


def test_grip_that_comes_back_faster_than_it_goes_is_refused():
    with pytest.raises(ValueError, match="rise_per_s"):
        TractionConfig(fall_per_s=0.1, rise_per_s=0.2)


@pytest.mark.parametrize("grip", [1.0, 0.5, 0.25])
def test_a_bend_is_driven_at_the_share_of_the_lateral_acceleration(grip):
    """At the root of the share, far from the goal: v^2 k is the share of the limit."""
    limits, path = SpeedLimits(maximum_mps=5.0, maximum_yaw_rate_radps=5.0), Polyline(figure_eight(), closed=True)
    policy = PathSpeed(limits, VehicleAnswer(rate_radps=20.0))
    for progress in (5.0, 10.0, 25.0):
        reduced = policy(path, 0.4, progress, 30.0, 5.0, grip)
        assert reduced == pytest.approx(math.sqrt(grip * limits.lateral_acceleration_mps2 / 0.4), rel=1e-9)
        assert reduced <= policy(path, 0.4, progress, 30.0, 5.0)
