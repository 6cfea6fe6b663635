# SPDX-License-Identifier: Apache-2.0
"""The delay that is learnt is the vehicle's, stays within its bounds, and stays where nothing is to be learnt."""

import math
from collections import deque

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.tracking.delay_estimation import DelayConfig, DelayEstimator
from runtime.tracking.vehicle_answer import VehicleAnswer

PERIOD = 0.02
ANSWER = VehicleAnswer()
CONFIG = DelayConfig()


class LateVehicle:
    """It answers as modelled, later, and is measured with noise."""

    def __init__(self, answering, delay_s, lag_s=0.0, noise=0.0, seed=0):
        self.answering, self.answer = answering, VehicleAnswer(lag_s=lag_s)
        self.pending = deque([(0.0, 0.0)] * round(delay_s / PERIOD))
        self.angle = self.speed = 0.0
        self.noise, self.rng = noise, np.random.Generator(np.random.PCG64(seed))

    def step(self, speed, angle):
        self.pending.append((speed, angle))
        speed, angle = self.pending.popleft()
        self.angle = self.answering.angle(self.answer, self.angle, angle, PERIOD)
        self.speed = self.answering.speed(self.answer, self.speed, speed, PERIOD)

    def measured(self):
        noise = self.rng.normal(0.0, self.noise, 2)
        return self.angle + noise[0], self.speed + noise[1]


def learn(vehicle, command, duration_s, estimator=None):
    estimator = estimator or DelayEstimator(CONFIG, ANSWER)
    trace = []
    for index in range(round(duration_s / PERIOD)):
        now = 100.0 + index * PERIOD
        estimator.step(now, *vehicle.measured())
        speed, angle = command(index * PERIOD)
        estimator.add(now, speed, angle)
        vehicle.step(speed, angle)
        trace.append(estimator.delay_s)
    return estimator, np.array(trace)


def weaving(time_s):
    return 0.6, 0.15 * math.sin(1.1 * time_s) + 0.1 * math.sin(0.37 * time_s)


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3, 0.46, 0.6, 0.9])
def test_converges_to_the_delay_and_stays(answering, delay):
    _, trace = learn(LateVehicle(answering, delay, noise=0.003), weaving, 20.0)
    assert trace[round(8.0 / PERIOD) :] == pytest.approx(delay, abs=0.04)


def test_a_lag_counts_as_delay(answering):
    _, trace = learn(LateVehicle(answering, 0.3, lag_s=0.1), weaving, 20.0)
    assert 0.33 <= trace[-1] <= 0.45


def test_the_start_of_the_speed_teaches_it_on_a_straight_path(answering):
    _, trace = learn(LateVehicle(answering, 0.6), lambda t: (min(0.4 * t, 0.6), 0.0), 10.0)
    assert trace[-1] == pytest.approx(0.6, abs=0.05)


def test_stays_where_nothing_changes(answering):
    _, trace = learn(LateVehicle(answering, 0.6), lambda t: (0.0, 0.0), 10.0)
    assert set(trace) == {CONFIG.initial_s}
    vehicle = LateVehicle(answering, 0.6, noise=0.003)
    estimator, _ = learn(vehicle, weaving, 15.0)
    learnt = estimator.delay_s
    for index in range(3000):
        now = 115.0 + index * PERIOD
        estimator.step(now, *vehicle.measured())
        estimator.add(now, 0.6, 0.1)
        vehicle.step(0.6, 0.1)
    assert estimator.delay_s == pytest.approx(learnt, abs=0.05)


def test_follows_a_delay_that_changes(answering):
    vehicle = LateVehicle(answering, 0.2)
    estimator = DelayEstimator(CONFIG, ANSWER)
    for index in range(round(50.0 / PERIOD)):
        if index == round(20.0 / PERIOD):
            vehicle.pending.extendleft([(vehicle.speed, vehicle.angle)] * round(0.3 / PERIOD))
        now = 100.0 + index * PERIOD
        estimator.step(now, *vehicle.measured())
        command = weaving(index * PERIOD)
        estimator.add(now, *command)
        vehicle.step(*command)
    assert estimator.delay_s == pytest.approx(0.5, abs=0.04)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 4, st.floats(-0.5, 3.0)), min_size=1, max_size=60))
def test_is_bounded_and_moves_no_faster_than_it_may_whatever_comes(steps):
    estimator, now, before = DelayEstimator(CONFIG, ANSWER), 1.0, CONFIG.initial_s
    for speed, angle, wanted_speed, wanted, wait in steps:
        now = max(now + wait, 0.1)
        estimator.step(now, angle, speed)
        estimator.add(now, wanted_speed, wanted)
        assert 0.0 <= estimator.delay_s <= CONFIG.maximum_s
        assert abs(estimator.delay_s - before) <= CONFIG.rate_per_s * max(wait, 0.0) + 1e-9
        before = estimator.delay_s


def test_with_a_maximum_of_nothing_no_delay_is_reckoned_with_nor_learnt(answering):
    estimator = DelayEstimator(DelayConfig(initial_s=0.0, maximum_s=0.0), ANSWER)
    _, trace = learn(LateVehicle(answering, 0.4), weaving, 10.0, estimator)
    assert not trace.any()
    assert math.isfinite(estimator.memory.sum())


def test_memory_is_all_that_is_remembered(answering):
    vehicle = LateVehicle(answering, 0.4)
    estimator, _ = learn(vehicle, weaving, 6.0)
    other = DelayEstimator(CONFIG, ANSWER, estimator.memory.copy())
    for now in (106.0, 106.02):
        for one in (estimator, other):
            one.step(now, 0.1, 0.5)
            one.add(now, 0.6, 0.2)
    assert other.memory.tobytes() == estimator.memory.tobytes()


def test_crossed_bounds_are_refused():
    with pytest.raises(msgspec.ValidationError, match="initial_s"):
        msgspec.convert({"initial_s": 1.5}, DelayConfig)
