# SPDX-License-Identifier: Apache-2.0
"""A bend ahead is braked for in time, wherever it lies."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.bends import Bend, arc, path_of_bends
from runtime.tracking.path_speed import bend_speed
from runtime.tracking.polyline import Polyline
from runtime.tracking.speed import SpeedLimits

LIMITS = SpeedLimits(
    maximum_mps=3.0,
    acceleration_mps2=0.8,
    deceleration_mps2=0.8,
    lateral_acceleration_mps2=2.0,
    maximum_yaw_rate_radps=3.0,
)
SPAN_M, WAY_M, RADIUS_M = 0.6, 12.0, 1.0
PATH = Polyline(path_of_bends((Bend(WAY_M), arc(90.0, RADIUS_M), Bend(5.0)), spacing_m=0.1))
IN_THE_BEND_MPS = math.sqrt(LIMITS.lateral_acceleration_mps2 * RADIUS_M)


def allowed(progress):
    return bend_speed(PATH, progress, 3.0, LIMITS, SPAN_M)


@given(st.floats(0.0, WAY_M))
def test_the_deceleration_suffices_from_everywhere_before_the_bend(progress):
    way = WAY_M + SPAN_M - progress  # the mean over a span knows of the whole bend there
    assert allowed(progress) <= math.sqrt(IN_THE_BEND_MPS**2 + 2.0 * LIMITS.deceleration_mps2 * way)


def test_it_is_not_slowed_down_for_sooner_than_it_must_be():
    assert allowed(0.0) == 3.0
    assert allowed(WAY_M + 0.7) == pytest.approx(IN_THE_BEND_MPS, rel=0.02)
    assert allowed(PATH.length - 3.0) == 3.0
