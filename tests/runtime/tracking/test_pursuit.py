# SPDX-License-Identifier: Apache-2.0
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.look_ahead import FixedLookAhead, FuzzyLookAhead
from runtime.tracking.pure_pursuit import bearing, drift_angle, low_pass, pursuit_curvature
from runtime.tracking.speed import (
    SpeedLimits,
    TrimmedSpeed,
    approach_speed,
    next_trim,
    ramped,
    regulated_speed,
    surface_stretch,
)
from runtime.tracking.tracker_config import TrackerConfig
from runtime.tracking.turn import TurnLimits, needs_turn, turn_rate

LIMITS = SpeedLimits()


@given(st.floats(0.5, 20.0), st.floats(0.05, 1.5), st.floats(-3.0, 3.0), st.booleans())
def test_the_arc_through_a_point_of_a_circle_is_that_circle(radius, angle, course, left):
    side = 1.0 if left else -1.0
    ahead, beside = radius * math.sin(angle), side * radius * (1 - math.cos(angle))
    target = (
        ahead * math.cos(course) - beside * math.sin(course),
        ahead * math.sin(course) + beside * math.cos(course),
    )
    assert pursuit_curvature(0.0, 0.0, course, target) == pytest.approx(side / radius, rel=1e-6)


def test_a_target_that_is_reached_asks_for_no_turn():
    assert pursuit_curvature(1.0, 2.0, 0.3, (1.0, 2.0)) == 0.0


def test_bearing_is_wrapped():
    assert bearing(0.0, 0.0, 3.0, (-1.0, -0.1)) == pytest.approx(math.atan2(-0.1, -1.0) + math.tau - 3.0)


def test_drift_angle_on_a_steady_turn_without_drift_is_zero():
    lag, rate = 0.2, 0.5
    course = 1.0 - rate * lag
    assert drift_angle((math.cos(course), math.sin(course)), 1.0, rate, lag) == pytest.approx(0.0)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.0, 1.0))
def test_two_half_steps_of_the_filter_make_one(previous, sample, dt):
    half = low_pass(low_pass(previous, sample, dt / 2, 0.5), sample, dt / 2, 0.5)
    assert half == pytest.approx(low_pass(previous, sample, dt, 0.5), abs=1e-12)


@given(st.floats(-1, 1), st.floats(-2, 2), st.floats(0, 3))
def test_fuzzy_distance_is_in_bounds_and_the_same_left_and_right(error, rate, speed):
    policy = FuzzyLookAhead()
    chosen = policy(error, rate, speed)
    assert policy.minimum_m <= chosen.distance <= policy.maximum_m
    assert chosen == policy(-error, rate, speed)


def test_fuzzy_distance_is_two_metres_at_rest_and_eq_17_otherwise():
    policy = FuzzyLookAhead(k_v0=1.0, k_w0=-0.5, lambda_v=0.4, lambda_w=0.2)
    assert policy(0.2, 0.1, 0.0).distance == 2.0
    chosen = policy(0.1, -0.1, 0.5)  # e = PS, ec = NS: ZO in table 1, NS in table 2
    assert (chosen.k_v, chosen.k_w) == pytest.approx((1.0, -1.5))
    assert chosen.distance == pytest.approx(2.0 + 0.4 * 1.0 * 0.25 + 0.2 * -1.5 * 0.5)


def test_a_growing_error_shortens_the_distance():
    policy = FuzzyLookAhead()
    assert policy(0.2, 0.0, 0.6).distance < policy(0.0, 0.0, 0.6).distance


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"look_ahead": {"kind": "fixed", "distance_m": 0.0}}, "look_ahead.distance_m"),
        ({"look_ahead": {"kind": "fuzzy", "minimum_m": 2.0, "maximum_m": 1.0}}, "minimum_m = 2.0 is above"),
        ({"look_ahead": {"kind": "magic"}}, "magic"),
        ({"look_ahead": {"kind": "fixed", "distance": 1.0}}, "unknown field"),
        ({"speed": {"acceleration_mps2": -1.0}}, "speed.acceleration_mps2"),
        ({"turn": {"start_rad": 0.3, "stop_rad": 0.4}}, "stop_rad = 0.4"),
    ],
)
def test_parameters_out_of_bounds_are_named(config, message):
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert(config, TrackerConfig)


def test_policies_are_chosen_by_kind():
    config = msgspec.convert({"look_ahead": {"kind": "fixed", "distance_m": 1.5}}, TrackerConfig)
    assert config.look_ahead == FixedLookAhead(1.5)
    assert config.look_ahead(0.3, 0.1, 0.6).distance == 1.5


@given(st.floats(0.0, 3.0), st.floats(-20.0, 20.0))
def test_regulated_speed_keeps_both_bounds(wanted, curvature):
    speed = regulated_speed(wanted, curvature, LIMITS)
    assert 0.0 <= speed <= wanted
    assert speed * speed * abs(curvature) <= LIMITS.lateral_acceleration_mps2 + 1e-9
    assert speed * abs(curvature) <= LIMITS.maximum_yaw_rate_radps + 1e-9


@given(st.floats(0.0, 3.0), st.floats(0.031, 5.0))
def test_approach_can_still_stop(wanted, remaining):
    speed = approach_speed(wanted, remaining, LIMITS)
    assert speed <= max(math.sqrt(2 * LIMITS.deceleration_mps2 * remaining), LIMITS.approach_minimum_mps)
    assert approach_speed(wanted, LIMITS.goal_tolerance_m, LIMITS) == 0.0


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.0, 0.1))
def test_ramp_is_limited_and_never_passes_the_aim(previous, wanted, dt):
    new = ramped(previous, wanted, 0.5, 0.8, dt)
    assert -0.8 * dt - 1e-12 <= new - previous <= 0.5 * dt + 1e-12
    assert min(previous, wanted) <= new <= max(previous, wanted)


@given(st.floats(-0.5, 0.5), st.floats(-3.0, 3.0))
def test_surface_is_longer_than_the_plan_by_the_slope_along_the_path(angle, heading):
    # A slope that rises along world x.
    normal = (-math.sin(angle), 0.0, math.cos(angle))
    rise = math.tan(angle) * math.cos(heading)
    assert surface_stretch(normal, heading) == pytest.approx(math.hypot(1.0, rise))
    assert surface_stretch((0.0, 0.0, 0.0), heading) == 1.0


def test_trim_finds_the_speed_that_a_scale_error_hides():
    trim = 0.0
    for _ in range(1000):
        trim = next_trim(trim, 0.6, 0.93 * 0.6 * (1 + trim) * 0.04, 0.04, TrimmedSpeed())
    assert 0.93 * (1 + trim) == pytest.approx(1.0, abs=1e-6)


@given(st.floats(-3.2, 3.2))
def test_turn_rate_is_odd_bounded_and_can_still_stop(error):
    limits = TurnLimits()
    rate = turn_rate(error, limits)
    assert rate == -turn_rate(-error, limits)
    assert abs(rate) <= limits.maximum_radps
    assert rate * rate / (2 * limits.deceleration_radps2) <= abs(error) + 1e-12


def test_turning_has_hysteresis():
    limits = TurnLimits(start_rad=1.0, stop_rad=0.1)
    assert not needs_turn(False, 0.5, limits)
    assert needs_turn(True, -0.5, limits)
    assert needs_turn(False, -1.1, limits)
    assert not needs_turn(True, 0.05, limits)
