# SPDX-License-Identifier: Apache-2.0
"""How a vehicle went over a slippery patch, judged on motions whose answer is known."""

import math

import numpy as np
import pytest

from runtime.recording.sliding import side_slip, sliding

T = np.arange(0.0, 10.0, 0.01)
HERE = (T > 4.0) & (T < 6.0)


def circle(radius, speed, turned=0.0):
    """Positions and yaw of a vehicle on a circle, with its axis turned from its direction of motion."""
    angle = speed * T / radius
    return radius * np.stack((np.sin(angle), 1.0 - np.cos(angle)), axis=1), angle - turned


@pytest.mark.parametrize("turned", [0.0, 0.1, -0.3])
@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_the_side_slip_is_the_angle_from_the_axis_to_the_motion(turned, speed):
    xy, yaw = circle(3.0, speed, turned)
    judged = sliding(T, xy, yaw, HERE)
    assert judged.side_slip_max_rad == pytest.approx(abs(turned), abs=0.01)
    assert judged.speed_mean_mps == pytest.approx(2.0, rel=1e-3)


def test_side_slip_has_the_sign_of_where_the_vehicle_drifts_to():
    velocity = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)])
    np.testing.assert_allclose(side_slip(velocity, np.zeros(3)), (math.pi / 4, -math.pi / 4, -math.pi / 4))


def test_speeds_are_those_on_the_patch():
    x = np.concatenate(([0.0], np.cumsum(0.01 * (3.0 - 0.25 * T[1:]))))
    judged = sliding(T, np.stack((x, 0.0 * x), axis=1), 0.0 * T, HERE)
    assert judged.speed_entry_mps == pytest.approx(2.0, abs=0.01)
    assert judged.speed_least_mps == pytest.approx(1.5, abs=0.01)
    assert judged.speed_mean_mps == pytest.approx(1.75, abs=0.01)
    assert judged.side_slip_max_rad == pytest.approx(0.0, abs=1e-9)


def test_one_that_never_came_to_the_patch_has_no_speeds_there():
    xy, yaw = circle(3.0, 2.0)
    assert sliding(T, xy, yaw, np.zeros(len(T), np.bool_)).summary() == {
        "side_slip_max_rad": pytest.approx(0.0, abs=0.01),
        "speed_entry_mps": None,
        "speed_least_mps": None,
        "speed_mean_mps": None,
    }


def test_a_vehicle_that_stands_does_not_slip():
    judged = sliding(T, np.zeros((len(T), 2)), np.ones(len(T)), HERE)
    assert judged.side_slip_max_rad == 0.0
    assert judged.speed_least_mps == 0.0
