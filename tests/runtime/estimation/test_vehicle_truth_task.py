# SPDX-License-Identifier: Apache-2.0
"""The vehicle's estimator that knows: what it passes on is the truth, in the frames of an estimate."""

import math

import numpy as np
import pytest

from runtime.estimation.vehicle_truth_task import RESTING_MPS, RESTING_RADPS, VehicleTruthTask
from runtime.models.rotations import quaternion_of_yaw
from runtime.vehicle_signals import VehicleState, VehicleTruth

SIZES = {"wheel": 4}
MS = 1_000_000


@pytest.fixture
def truth():
    """Of a vehicle that drives north-west, heading north, and turns."""
    record = VehicleTruth("/ugv/truth", SIZES)
    record.stamp_ns = 5 * MS
    record.position, record.orientation = (1.0, 2.0, 0.3), quaternion_of_yaw(0.5 * math.pi)
    record.linear_velocity, record.angular_velocity = (-0.2, 0.6, 0.01), (0.0, 0.1, 0.4)
    record.slip = (0.0, 0.1, -0.2, 0.3)
    return record


@pytest.fixture
def estimate(truth):
    """What the task makes of the truth."""
    output = VehicleState("/ugv/body_state", SIZES)
    task = VehicleTruthTask(truth, output)
    assert (task.reads, task.writes) == ((truth,), (output,))

    def step(now_ns=7 * MS):
        task.step(now_ns)
        return output

    return step


def test_pose_and_twist_are_passed_on_and_the_velocity_is_turned_into_the_vehicle(truth, estimate):
    output = estimate()
    assert output.stamp_ns == 7 * MS
    for name in ("position", "orientation", "linear_velocity", "angular_velocity", "slip"):
        np.testing.assert_array_equal(getattr(output, name), getattr(truth, name))
    np.testing.assert_allclose(output.velocity, (0.6, 0.2), atol=1e-12)
    assert not output.resting


def test_nothing_is_told_before_there_is_a_truth(truth, estimate):
    truth.stamp_ns = 0
    assert estimate().stamp_ns == 0
    np.testing.assert_array_equal(estimate().position, np.zeros(3))


@pytest.mark.parametrize(
    ("velocity", "yaw_rate", "resting"),
    [
        ((0.0, 0.0), 0.0, True),
        ((0.9 * RESTING_MPS, -0.9 * RESTING_MPS), 0.9 * RESTING_RADPS, True),
        ((0.0, 1.1 * RESTING_MPS), 0.0, False),
        ((-1.1 * RESTING_MPS, 0.0), 0.0, False),
        ((0.0, 0.0), -1.1 * RESTING_RADPS, False),
    ],
)
def test_it_rests_below_bounds_of_every_velocity(truth, estimate, velocity, yaw_rate, resting):
    truth.linear_velocity, truth.angular_velocity = (*velocity, 0.0), (0.0, 0.0, yaw_rate)
    assert estimate().resting == resting
