# SPDX-License-Identifier: Apache-2.0
"""The centre angle of four wheels is that of the arc they roll on, and none where they roll on no arc."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.models.dual_ackermann import centre_angle as angle_of_curvature
from runtime.models.vehicle import VehicleGeometry
from runtime.tracking.wheel_motion import centre_angle

VEHICLE = VehicleGeometry()
L, B = VEHICLE.wheelbase_m, VEHICLE.track_m
SHARPEST = 2.0 / B
"""The inner wheels then stand across, 1/m."""


def on_an_arc(curvature):
    """The angles of all four wheels, from where they are and where the arc's centre is."""
    front = [math.atan2(0.5 * L * curvature, 1.0 - y * curvature) for _, y in VEHICLE.wheels[:2]]
    return np.array([*front, *(-angle for angle in front)])


@given(st.floats(-SHARPEST, SHARPEST))
def test_is_exact_on_every_arc(curvature):
    assert centre_angle(on_an_arc(curvature), VEHICLE) == pytest.approx(angle_of_curvature(curvature, L), abs=1e-12)


def test_at_the_papers_smallest_radius_it_is_not_the_mean_of_the_angles():
    steering = on_an_arc(1.0 / 0.75)
    assert math.degrees(centre_angle(steering, VEHICLE)) == pytest.approx(37.95, abs=0.01)
    assert math.degrees(np.abs(steering).mean()) == pytest.approx(42.3, abs=0.1)


@given(st.floats(-math.pi / 2.0, math.pi / 2.0))
def test_parallel_wheels_make_no_arc(direction):
    assert centre_angle(np.full(4, direction), VEHICLE) == pytest.approx(0.0, abs=1e-12)


def test_wheels_that_turn_the_vehicle_in_place_make_no_arc():
    across = math.atan2(L, B)
    assert centre_angle(np.array([-across, across, across, -across]), VEHICLE) == pytest.approx(0.0, abs=1e-12)


@given(st.lists(st.floats(-0.002, 0.002), min_size=4, max_size=4))
def test_about_straight_it_is_the_mean_of_the_angles(noise):
    front_left, front_right, rear_left, rear_right = noise
    mean = 0.25 * (front_left + front_right - rear_left - rear_right)
    assert centre_angle(np.array(noise), VEHICLE) == pytest.approx(mean, abs=1e-5)
