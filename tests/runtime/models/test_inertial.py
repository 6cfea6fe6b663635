# SPDX-License-Identifier: Apache-2.0
"""What an inertial sample may be."""

import numpy as np
import pytest

from runtime.compiled import table_of
from runtime.models.inertial import InertialConfig, is_finite_sample, is_plausible
from runtime.signals import Imu

CONFIG = InertialConfig()
DOWN, STILL = (0.0, 0.0, 9.81), (0.0, 0.0, 0.0)
RESTING = np.array(DOWN + STILL)


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
    assert is_plausible(table_of(CONFIG)[0], sample(acceleration, rate), RESTING, RESTING) == plausible


def test_a_fast_turn_is_plausible_after_another():
    before = np.array((*DOWN, 0.0, 30.0, 0.0))
    assert is_plausible(table_of(CONFIG)[0], sample(rate=(0.0, 33.0, 0.0)), before, before)
    assert not is_plausible(table_of(CONFIG)[0], sample(rate=(0.0, 36.0, 0.0)), before, before)


def test_of_two_in_a_row_that_agree_the_second_is_believed():
    thrown = np.array((120.0, 0.0, 0.0, 0.0, 12.0, 0.0))
    config, now = table_of(CONFIG)[0], sample((110.0, 10.0, 0.0), (0.0, 13.0, 0.0))
    assert not is_plausible(config, now, RESTING, RESTING)
    assert is_plausible(config, now, RESTING, thrown)
    assert is_plausible(config, sample(), RESTING, thrown), "after a spike all is as before"


def test_nothing_follows_from_what_is_no_number():
    nothing = np.full(6, np.nan)
    assert is_plausible(table_of(CONFIG)[0], sample(), RESTING, nothing)
    assert not is_plausible(table_of(CONFIG)[0], sample(), nothing, nothing)
