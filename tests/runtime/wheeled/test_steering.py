# SPDX-License-Identifier: Apache-2.0
"""Steering kinematics: the signed form against the paper's equations, and what must hold for any twist."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.models.dual_ackermann import centre_angle, centre_curvature, inner_angle
from runtime.models.vehicle import VehicleGeometry
from runtime.wheeled.steering import (
    STANDSTILL,
    Twist,
    WheelTargets,
    reachable_angle,
    slowed,
    steered_share,
    twist_of_wheels,
    unsaturated,
    wheel_targets,
    wheel_velocities,
)

VEHICLE = VehicleGeometry()
AHEAD = (0.0, 0.0, 0.0, 0.0)
QUARTER = math.pi / 2.0

speeds = st.floats(-3.0, 3.0)
rates = st.floats(-3.0, 3.0)
angles = st.floats(-QUARTER, QUARTER)
twists = st.builds(Twist, speeds, speeds, rates)
four_angles = st.tuples(angles, angles, angles, angles)


@given(st.floats(0.5, 50.0), st.floats(0.1, 3.0))
def test_left_arc_is_the_papers_dual_ackermann(radius, speed):
    L, B = VEHICLE.wheelbase_m, VEHICLE.track_m
    targets = wheel_targets(Twist(speed, 0.0, speed / radius), VEHICLE, AHEAD)
    inner, outer = math.atan(L / (2 * radius - B)), math.atan(L / (2 * radius + B))  # eq 1-2
    assert targets.steering == pytest.approx((inner, outer, -inner, -outer))
    fast = speed / radius * math.hypot(radius + B / 2, L / 2) / VEHICLE.wheel_radius_m  # eq 4
    slow = speed / radius * math.hypot(radius - B / 2, L / 2) / VEHICLE.wheel_radius_m  # eq 3, inner pair
    assert targets.speed == pytest.approx((slow, fast, slow, fast))
    assert inner_angle(1.0 / radius, VEHICLE) == pytest.approx(inner)


@pytest.mark.parametrize(("radius", "degrees"), [(0.75, 56.9), (1.02, 42.7), (1.3575, 30.2)])
def test_inner_angles_of_table_ii(radius, degrees):
    assert math.degrees(inner_angle(-1.0 / radius, VEHICLE)) == pytest.approx(degrees, abs=0.8)


@given(angles.filter(lambda a: abs(a) < 1.5))
def test_centre_angle_and_curvature_are_inverse(angle):
    assert centre_angle(centre_curvature(angle, 1.17), 1.17) == pytest.approx(angle, abs=1e-12)


@given(st.floats(0.1, 3.0), angles)
def test_crab_has_equal_wheels(speed, direction):
    targets = wheel_targets(Twist(speed * math.cos(direction), speed * math.sin(direction), 0.0), VEHICLE, AHEAD)
    assert targets.steering == pytest.approx((direction,) * 4, abs=1e-6)
    assert targets.speed == pytest.approx((speed / VEHICLE.wheel_radius_m,) * 4)


def test_spin_turns_about_the_centre():
    targets = wheel_targets(Twist(0.0, 0.0, 1.0), VEHICLE, AHEAD)
    angle = math.atan2(VEHICLE.wheelbase_m, VEHICLE.track_m)
    rolling = math.hypot(VEHICLE.wheelbase_m, VEHICLE.track_m) / 2 / VEHICLE.wheel_radius_m
    assert targets.steering == pytest.approx((-angle, angle, angle, -angle))
    assert targets.speed == pytest.approx((-rolling, rolling, -rolling, rolling))


@given(twists, four_angles)
def test_wheels_roll_without_slip(twist, present):
    targets = wheel_targets(twist, VEHICLE, present, rest_mps=1e-9)
    for (vx, vy), angle, speed in zip(wheel_velocities(twist, VEHICLE), targets.steering, targets.speed, strict=True):
        rolling = speed * VEHICLE.wheel_radius_m
        assert (rolling * math.cos(angle), rolling * math.sin(angle)) == pytest.approx((vx, vy), abs=1e-7)
        assert abs(angle) <= VEHICLE.steering_range_rad


@given(twists, four_angles)
def test_twist_comes_back_from_the_wheels(twist, present):
    targets = wheel_targets(twist, VEHICLE, present, rest_mps=1e-9)
    assert twist_of_wheels(*targets, VEHICLE) == pytest.approx(twist, abs=1e-7)


@given(twists, four_angles)
def test_no_wheel_turns_further_than_a_quarter_unless_its_limit_forbids(twist, present):
    targets = wheel_targets(twist, VEHICLE, present, rest_mps=1e-9)
    for angle, before in zip(targets.steering, present, strict=True):
        other = angle - math.copysign(math.pi, angle)
        assert abs(angle - before) <= QUARTER + 1e-9 or abs(other) > VEHICLE.steering_range_rad


@given(speeds, st.floats(-1.0, 1.0), four_angles)
def test_reversing_keeps_the_angles(speed, curvature, present):
    forward = wheel_targets(Twist(speed, 0.0, speed * curvature), VEHICLE, present, rest_mps=1e-6)
    backward = wheel_targets(Twist(-speed, 0.0, -speed * curvature), VEHICLE, forward.steering, rest_mps=1e-6)
    assert backward.steering == pytest.approx(forward.steering, abs=1e-9)
    assert backward.speed == pytest.approx(tuple(-s for s in forward.speed), abs=1e-9)


@given(four_angles)
def test_standstill_holds_the_angles(present):
    assert wheel_targets(STANDSTILL, VEHICLE, present) == WheelTargets(present, (0.0,) * 4)


def test_wheel_at_the_centre_of_rotation_holds_its_angle():
    x, y = VEHICLE.wheels[0]
    targets = wheel_targets(Twist(y, -x, 1.0), VEHICLE, (0.3, 0.0, 0.0, 0.0))
    assert targets.steering[0] == 0.3
    assert targets.speed[0] == 0.0
    assert min(map(abs, targets.speed[1:])) > 0.0


@given(st.floats(-math.pi, math.pi), angles, st.floats(0.3, QUARTER), st.floats(0.0, 0.3))
def test_reached_angle_is_within_the_limit(direction, present, limit, slack):
    assert abs(reachable_angle(direction, present, limit, slack)) <= limit


def test_slack_spares_the_half_turn_at_the_limit():
    beyond = QUARTER + 0.1
    assert reachable_angle(beyond, QUARTER, QUARTER) == pytest.approx(beyond - math.pi)
    assert reachable_angle(beyond, QUARTER, QUARTER, slack=0.2) == QUARTER


def test_wheel_that_cannot_point_along_its_motion_turns_by_the_part_along_it():
    narrow = VehicleGeometry(steering_range_rad=0.5)
    targets = wheel_targets(Twist(0.0, 1.0, 0.0), narrow, AHEAD)
    assert {abs(angle) for angle in targets.steering} == {0.5}
    assert targets.speed == pytest.approx((math.sin(0.5) / narrow.wheel_radius_m,) * 4)


@given(twists, st.floats(0.1, 10.0))
def test_saturation_keeps_the_direction_of_the_twist(twist, maximum):
    targets = wheel_targets(twist, VEHICLE, AHEAD, rest_mps=1e-9)
    held = unsaturated(targets, maximum)
    assert max(map(abs, held.speed)) <= maximum * (1.0 + 1e-12)
    fastest = max(map(abs, targets.speed))
    share = min(1.0, maximum / fastest) if fastest > 0.0 else 1.0
    assert twist_of_wheels(*held, VEHICLE) == pytest.approx(twist.scaled(share), abs=1e-6)


def test_share_falls_from_full_to_none():
    shares = [steered_share((error, 0.0, 0.0, 0.0), AHEAD, 0.2, 0.6) for error in (0.1, -0.2, 0.4, 0.6, -1.0)]
    assert shares == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])
    assert slowed(WheelTargets(AHEAD, (2.0, -2.0, 4.0, 0.0)), 0.5).speed == (1.0, -1.0, 2.0, 0.0)
