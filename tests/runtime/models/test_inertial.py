# SPDX-License-Identifier: Apache-2.0
"""What an inertial sample may be."""

import numpy as np
import pytest

from runtime.compiled import table_of
from runtime.models.inertial import InertialConfig, is_finite_sample, is_plausible
from runtime.signals import Imu

CONFIG = InertialConfig()
DOWN, STILL = np.array((0.0, 0.0, 9.81)), np.zeros(3)


def sample(acceleration=DOWN, rate=STILL):
    imu = Imu("/imu")
    imu.linear_acceleration, imu.angular_velocity = acceleration, rate
    return imu.table[0]


@pytest.mark.parametrize("which", ["linear_acceleration", "angular_velocity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_every_number_must_be_finite(which, value):
    imu = Imu("/imu")
    assert is_finite_sample(imu.table[0])
    getattr(imu, which)[1] = value
    assert not is_finite_sample(imu.table[0])


@pytest.mark.parametrize(
    ("acceleration", "rate", "plausible"),
    [
        ((0.0, 0.0, 9.81), (0.0, 0.0, 0.0), True),
        ((60.0, 0.0, 30.0), (3.0, -2.0, 1.0), True),
        ((0.0, 0.0, -161.0), (0.0, 0.0, 0.0), False),
        ((-95.0, 0.0, -40.0), (0.0, 0.0, 0.0), False),
        ((0.0, 0.0, 9.81), (0.0, 8.1, 0.0), False),
        ((0.0, 0.0, 9.81), (40.0, 0.0, 0.0), False),
    ],
)
def test_magnitude_and_change_have_their_bounds(acceleration, rate, plausible):
    assert is_plausible(table_of(CONFIG)[0], sample(acceleration, rate), DOWN, STILL) == plausible


def test_a_fast_turn_is_plausible_after_another():
    before = np.array((0.0, 30.0, 0.0))
    assert is_plausible(table_of(CONFIG)[0], sample(rate=(0.0, 33.0, 0.0)), DOWN, before)
    assert not is_plausible(table_of(CONFIG)[0], sample(rate=(0.0, 36.0, 0.0)), DOWN, before)
