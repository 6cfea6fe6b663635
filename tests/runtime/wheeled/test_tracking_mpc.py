# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.wheeled.tracking_mpc import TrackingMpc, TrackingMpcConfig

CONFIG = TrackingMpcConfig(solver="daqp")
MPC = TrackingMpc(CONFIG)
STRAIGHT = np.zeros(MPC.stations)


def simulated(lateral, heading, angle, inputs, speed, curvatures, steps=50):
    """The nonlinear model in small steps."""
    fine = CONFIG.step_s / steps
    for wanted, curvature in zip(inputs, curvatures, strict=True):
        for _ in range(steps):
            lateral += fine * speed * math.sin(heading)
            heading += fine * speed * (2.0 * math.tan(angle) / CONFIG.wheelbase_m - curvature)
            angle += fine * (wanted - angle) / CONFIG.lag_s
    return lateral, heading, angle


@pytest.mark.parametrize("curvature", [0.0, 0.3, -0.4])
def test_linear_model_is_that_of_the_vehicle(curvature):
    curvatures = np.full(MPC.stations, curvature)
    references = np.arctan(0.5 * CONFIG.wheelbase_m * curvatures)
    inputs = references + 0.03 * np.sin(0.7 * np.arange(MPC.stations))
    state = np.array([0.1, 0.05, float(references[0])])
    free, forced = MPC._predicted(state, 0.8, references)
    predicted = free[-1] + forced[-1] @ inputs
    assert predicted == pytest.approx(simulated(*state, inputs, 0.8, curvatures), abs=0.03)


def test_on_the_path_it_asks_for_the_paths_own_curvature():
    assert MPC.solve(0.0, 0.0, 0.0, 0.0, 0.6, STRAIGHT).angle == pytest.approx(0.0, abs=1e-12)
    angle = math.atan(0.5 * CONFIG.wheelbase_m * 0.3)
    bend = np.full(MPC.stations, 0.3)
    assert MPC.solve(0.0, 0.0, angle, angle, 0.6, bend).angle == pytest.approx(angle, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-0.5, 0.5), st.floats(-0.6, 0.6), st.floats(0.0, 3.0))
def test_is_odd_solved_and_within_the_steerings_rate(lateral, heading, angle, command, speed):
    answer = MPC.solve(lateral, heading, angle, command, speed, STRAIGHT)
    mirrored = MPC.solve(-lateral, -heading, -angle, -command, speed, STRAIGHT)
    assert answer.solved
    assert answer.angle == pytest.approx(-mirrored.angle, abs=1e-6)
    assert abs(answer.angle - command) <= CONFIG.rate_radps * CONFIG.step_s + 1e-6


def test_both_solvers_agree():
    proxqp = TrackingMpc(TrackingMpcConfig(solver="proxqp"))
    bend = np.linspace(0.0, 0.4, MPC.stations)
    answers = [mpc.solve(-0.4, 0.2, 0.1, 0.1, 0.8, bend) for mpc in (MPC, proxqp)]
    assert all(answer.solved for answer in answers)
    assert answers[0].angle == pytest.approx(answers[1].angle, abs=1e-6)


def test_what_is_not_finite_is_not_solved():
    assert not MPC.solve(math.nan, 0.0, 0.0, 0.0, 0.6, STRAIGHT).solved


@pytest.mark.parametrize("delay", [0.0, 0.6])
def test_returns_to_a_line_as_fast_as_the_steering_allows(delay):
    """From 1.5 m beside, at 0.6 m/s; with the delay in the initial state the bound of the mean error is 0.228 m."""
    step, period, rate = 0.02, 0.12, CONFIG.rate_radps
    y, yaw, angle, command = -1.5, 0.0, 0.0, 0.0
    pending, errors = [0.0] * round(delay / step), []

    def moved(state, wanted):
        y, yaw, angle = state
        angle += min(max(wanted - angle, -rate * step), rate * step)
        yaw += step * 0.6 * 2.0 * math.tan(angle) / CONFIG.wheelbase_m
        return y + step * 0.6 * math.sin(yaw), yaw, angle

    for tick in range(round(14.0 / step)):
        if tick % round(period / step) == 0:
            state = (y, yaw, angle)
            for wanted in pending:
                state = moved(state, wanted)
            command = MPC.solve(*state, command, 0.6, STRAIGHT).angle
        pending.append(command)
        y, yaw, angle = moved((y, yaw, angle), pending.pop(0))
        errors.append(abs(y))
    assert sum(errors) * step / 25.0 <= 0.232 - 1.5 * (0.6 - delay) / 25.0
    assert max(errors[round(6.7 / step) :]) <= 0.05
