# SPDX-License-Identifier: Apache-2.0
"""A push is withstood by a robot that neither falls nor leaves its path for long."""

import json

import numpy as np
import pytest

from runtime.recording.push import push_recovery
from runtime.tracking.paths import Polyline, straight

TEN_METRES = Polyline(straight(10.0))


def pushed(back_after_s=1.0, displaced=0.3, slow_for_s=0.0, until=20.0):
    """Walk along the x axis at 0.5 m/s; at 5 s a push sideways, that decays, and perhaps a stop."""
    t = np.arange(0.0, until, 0.01)
    moving = ~((t > 5.0) & (t < 5.0 + slow_for_s))
    x = np.cumsum(np.where(moving, 0.005, 0.0))
    away = np.where(t < 5.0, 0.0, displaced * np.clip(1.0 - (t - 5.0) / back_after_s, 0.0, 1.0))
    return t, np.column_stack((x, away))


def test_a_push_that_is_walked_off():
    result = push_recovery(*pushed(), TEN_METRES, 5.0, 0.5, fell=False)
    assert result.passed
    assert result.back_at_speed
    assert result.displacement_m == pytest.approx(0.3, abs=0.01)
    assert result.distance_later_m == pytest.approx(0.0, abs=1e-9)
    assert result.speed_later_mps == pytest.approx(0.5, rel=1e-3)
    json.dumps(result.summary(), allow_nan=False)


def test_a_push_off_the_path_is_not_passed():
    result = push_recovery(*pushed(back_after_s=12.0), TEN_METRES, 5.0, 0.5, fell=False)
    assert not result.passed
    assert result.back_at_speed
    assert result.distance_later_m == pytest.approx(0.3 * 7 / 12, abs=0.01)


def test_a_push_that_stops_the_robot_is_passed_but_not_back_at_speed():
    result = push_recovery(*pushed(slow_for_s=4.0), TEN_METRES, 5.0, 0.5, fell=False)
    assert result.passed
    assert not result.back_at_speed


def test_a_fall_passes_nothing():
    result = push_recovery(*pushed(), TEN_METRES, 5.0, 0.5, fell=True)
    assert not result.passed
    assert not result.back_at_speed


@pytest.mark.parametrize(("until", "push_end_s"), [(20.0, None), (9.0, 5.0), (5.0, 5.0)])
def test_a_push_that_was_not_seen_through_is_not_passed(until, push_end_s):
    result = push_recovery(*pushed(until=until), TEN_METRES, push_end_s, 0.5, fell=False)
    assert not result.passed
    json.dumps(result.summary(), allow_nan=False)
