# SPDX-License-Identifier: Apache-2.0
"""A bend ahead is braked for in time, wherever it lies, and so is one that the steering needs time for."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.bends import Bend, arc, path_of_bends
from runtime.tracking.curvature import mean_curvature
from runtime.tracking.path_speed import bend_speed, steering_speed
from runtime.tracking.polyline import Polyline
from runtime.tracking.speed import SpeedLimits
from runtime.tracking.vehicle_answer import VehicleAnswer

LIMITS = SpeedLimits(
    maximum_mps=3.0,
    acceleration_mps2=0.8,
    deceleration_mps2=0.8,
    lateral_acceleration_mps2=2.0,
    maximum_yaw_rate_radps=3.0,
)
SPAN_M, WAY_M, RADIUS_M = 0.6, 12.0, 1.0
PATH = Polyline(path_of_bends((Bend(WAY_M), arc(90.0, RADIUS_M), Bend(5.0)), spacing_m=0.1))
AT_ONCE, SLOWLY = VehicleAnswer(rate_radps=20.0), VehicleAnswer(rate_radps=0.4)
IN_THE_BEND_MPS = math.sqrt(LIMITS.lateral_acceleration_mps2 * RADIUS_M)


def allowed(progress):
    return bend_speed(PATH, progress, 3.0, LIMITS, SPAN_M, AT_ONCE)


@given(st.floats(0.0, WAY_M))
def test_the_deceleration_suffices_from_everywhere_before_the_bend(progress):
    way = WAY_M + SPAN_M - progress  # the mean over a span knows of the whole bend there
    assert allowed(progress) <= math.sqrt(IN_THE_BEND_MPS**2 + 2.0 * LIMITS.deceleration_mps2 * way)


def test_it_is_not_slowed_down_for_sooner_than_it_must_be():
    assert allowed(0.0) == 3.0
    assert allowed(WAY_M + 0.7) == pytest.approx(IN_THE_BEND_MPS, rel=0.02)
    assert allowed(PATH.length - 3.0) == 3.0


@given(st.floats(0.5, 3.0), st.floats(0.1, 1.0))
def test_the_steering_can_turn_as_fast_as_the_path_bends(wanted, rate):
    """Driven at the speed allowed, the centre angle of the mean curvature changes no faster than the steering can."""
    answer = VehicleAnswer(rate_radps=rate)
    path = Polyline(path_of_bends((Bend(3.0), arc(45.0), arc(-90.0), arc(45.0), Bend(3.0)), spacing_m=0.1))
    step = 0.05
    for station in range(int(path.length / step)):
        progress = station * step
        speed = bend_speed(path, progress, wanted, LIMITS, SPAN_M, answer)
        before, after = (
            answer.angle_of(mean_curvature(path, progress + way, SPAN_M)) for way in (-0.5 * SPAN_M, 0.5 * SPAN_M)
        )
        assert abs(after - before) * speed <= rate * SPAN_M * (1.0 + 1e-9)


def test_a_reversal_ahead_is_braked_for():
    """From left to right at once, where either bend alone may be driven at the full speed."""
    path = Polyline(path_of_bends((arc(90.0), arc(-90.0)), spacing_m=0.1))
    middle = 0.5 * path.length
    slowest = SLOWLY.rate_radps * SPAN_M / (2.0 * SLOWLY.angle_of(0.4))
    speeds = [bend_speed(path, middle - way, 2.0, LIMITS, SPAN_M, SLOWLY) for way in (3.5, 2.0, 1.0, 0.5, 0.0)]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == pytest.approx(slowest, rel=0.05)
    assert speeds[0] == 2.0


@given(st.floats(0.01, 5.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.01, 5.0))
def test_the_speed_of_a_change_is_what_the_steering_takes_for_it(wanted, before, after, way):
    speed = steering_speed(wanted, before, after, way, SLOWLY)
    turn = abs(SLOWLY.angle_of(after) - SLOWLY.angle_of(before))
    assert 0.0 < speed <= wanted
    assert speed * turn <= SLOWLY.rate_radps * way * (1.0 + 1e-9)
    assert speed == wanted or speed * turn == pytest.approx(SLOWLY.rate_radps * way)
