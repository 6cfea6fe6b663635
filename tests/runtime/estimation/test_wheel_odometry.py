# SPDX-License-Identifier: Apache-2.0
"""The wheels' twist against least squares by numpy, and with wheels that slip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.estimation.wheel_odometry import (
    SLIPPING,
    Equations,
    rolling_equations,
    slip_ratios,
    twist_of_wheels,
)

CONFIG = table_of(VehicleFilterConfig())[0]
ALL = np.ones(4, dtype=np.bool_)
SURE = np.diag((0.02, 0.02, 0.02)) ** 2

numbers = st.floats(-2.0, 2.0)
twists = st.tuples(numbers, numbers, st.floats(-1.5, 1.5)).map(np.array)
noises = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def read(vehicle, steering, speed, expected, usable=ALL, spread=SURE):
    equations = rolling_equations(CONFIG, vehicle.positions, vehicle.radius, steering, speed)
    return twist_of_wheels(CONFIG, equations, usable, expected, spread)


@given(twists)
def test_wheels_that_roll_give_the_twist_in_any_direction(vehicle, twist):
    odometry = read(vehicle, *vehicle.wheels_for(twist), twist)
    np.testing.assert_allclose(odometry.twist, twist, atol=1e-9)
    np.testing.assert_allclose(odometry.weight, 1.0, atol=1e-9)


@given(twists, noises)
def test_noisy_wheels_give_the_least_squares_twist_of_the_same_weights(vehicle, twist, rng):
    steering, speed = vehicle.wheels_for(twist)
    steering, speed = steering + 0.01 * rng.standard_normal(4), speed + 0.05 * rng.standard_normal(4)
    odometry = read(vehicle, steering, speed, twist)
    rows, right, deviation = [], [], []
    for (x, y), angle, rolling in zip(vehicle.positions, steering, vehicle.radius * speed, strict=True):
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        motion = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
        rows += [along @ motion, across @ motion]
        right += [rolling, 0.0]
        deviation += [np.hypot(0.01, 0.02 * rolling), np.hypot(0.02, 0.01 * rolling)]
    scale = np.sqrt(np.repeat(odometry.weight, 2)) / deviation
    expected = np.linalg.lstsq(np.array(rows) * scale[:, None], np.array(right) * scale, rcond=None)[0]
    np.testing.assert_allclose(odometry.twist, expected, atol=1e-9)
    information = np.array(rows).T @ np.diag(scale**2) @ np.array(rows)
    np.testing.assert_allclose(np.linalg.inv(odometry.covariance), information, rtol=1e-9, atol=1e-6)


@given(twists, st.sampled_from(range(4)), st.floats(0.3, 3.0), st.sampled_from((-1.0, 1.0)))
def test_one_wheel_that_slips_is_found_without_knowing_the_motion(vehicle, twist, wheel, slip, sense):
    steering, speed = vehicle.wheels_for(twist)
    speed[wheel] += sense * max(slip, 0.5 * abs(speed[wheel])) / vehicle.radius
    odometry = read(vehicle, steering, speed, np.zeros(3), spread=100.0 * np.eye(3))
    assert np.argmin(odometry.weight) == wheel
    assert odometry.weight[wheel] < SLIPPING < np.delete(odometry.weight, wheel).min()
    np.testing.assert_allclose(odometry.twist, twist, atol=0.05)


@given(twists, st.sets(st.sampled_from(range(4)), min_size=2, max_size=3), st.floats(0.5, 3.0))
def test_most_wheels_may_slip_alike_if_the_motion_is_known(vehicle, twist, wheels, slip):
    steering, speed = vehicle.wheels_for(twist)
    which = sorted(wheels)
    speed[which] += np.maximum(slip, 0.8 * np.abs(speed[which])) / vehicle.radius
    odometry = read(vehicle, steering, speed, twist)
    assert (odometry.weight[which] < SLIPPING).all()
    assert (np.delete(odometry.weight, which) > SLIPPING).all()
    error = odometry.twist - twist
    # one wheel leaves a part of the motion open, and the covariance says so
    assert error @ np.linalg.solve(odometry.covariance, error) < 1.0


def test_the_fewer_wheels_agree_the_less_certain_is_the_twist(vehicle):
    twist = np.array([1.0, 0.0, 0.3])
    steering, speed = vehicle.wheels_for(twist)
    deviations = []
    for slipping in range(5):
        odometry = read(vehicle, steering, speed + (np.arange(4) < slipping) * 20.0, twist)
        deviations.append(np.sqrt(np.trace(odometry.covariance)))
        assert np.isfinite(odometry.twist).all()
    assert deviations == sorted(deviations)
    assert deviations[2] < 0.1
    assert deviations[4] > 10.0


@pytest.mark.parametrize("missing", [{0}, {3}, {0, 3}, {1, 2}, {2, 3}])
def test_a_wheel_without_a_reading_has_no_part(vehicle, missing):
    twist = np.array([0.8, -0.2, 0.4])
    steering, speed = vehicle.wheels_for(twist)
    usable = np.array([wheel not in missing for wheel in range(4)])
    steering[~usable], speed[~usable] = 1.0, 50.0
    odometry = read(vehicle, steering, speed, twist, usable)
    np.testing.assert_allclose(odometry.twist, twist, atol=1e-9)
    assert (odometry.weight[~usable] == 0.0).all()


@given(twists, st.floats(-0.9, 0.9))
def test_the_slip_ratio_is_that_of_the_wheel(vehicle, twist, ratio):
    steering, speed = vehicle.wheels_for(twist)
    equations = rolling_equations(CONFIG, vehicle.positions, vehicle.radius, steering, speed)
    faster = np.abs(vehicle.radius * speed) > 0.2
    if ratio > 0.0:
        spun = Equations(equations.matrix, equations.right / (1.0 - ratio), equations.variance)
    else:
        spun = Equations(equations.matrix, equations.right * (1.0 + ratio), equations.variance)
    # forward or backward, a wheel that turns too fast has a ratio of the sign of its speed
    expected = np.sign(speed) * ratio
    np.testing.assert_allclose(slip_ratios(spun, twist)[faster], expected[faster], atol=1e-9)
