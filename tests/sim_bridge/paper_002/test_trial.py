# SPDX-License-Identifier: Apache-2.0
"""Trials on the kinematic plants give the figures that were found independently of this code."""

import math
import pickle

import numpy as np
import pytest

from sim_bridge.paper_002.contenders import (
    COMPENSATED,
    CONTENDERS,
    GAINS,
    OURS,
    OURS_TOLD,
    PLAIN,
    DelayHandling,
    configuration,
    policy_of,
)
from sim_bridge.paper_002.plants import IDEAL, PLANTS, PROMPT, late_command, late_pose
from sim_bridge.paper_002.results import SHAPES, all_trials
from sim_bridge.paper_002.trial import STRAIGHT, Trial, drive

LATE_POSE, LATE_COMMAND = late_pose(600_000_000), late_command(600_000_000)
# mean error m, overshoot m, and settling time s where it was given, for K_r 0 (plain), 0.6, 0.9 and 1.2
FOUND = {
    LATE_POSE: ((0.258, 0.64, None), (0.219, 0.33, None), (0.209, 0.09, None), (0.225, 0.06, None)),
    LATE_COMMAND: ((0.297, 0.67, 12.5), (0.261, 0.40, 9.7), (0.245, 0.09, 9.3), (0.261, 0.06, 9.6)),
}


@pytest.mark.parametrize("plant", FOUND)
def test_the_straight_with_delay_gives_the_known_figures(plant):
    for contender, (mean_m, overshoot_m, settled_s) in zip(GAINS, FOUND[plant], strict=True):
        settling = drive(Trial(STRAIGHT, plant, contender)).settling
        assert settling.mean_25_s_m == pytest.approx(mean_m, abs=0.004)
        assert settling.overshoot_m == pytest.approx(overshoot_m, abs=0.02)
        if settled_s is not None:
            assert settling.time_s == pytest.approx(settled_s, abs=0.35)


def test_the_first_angle_is_that_of_the_papers_equation_7():
    """1.5 m beside with L_a 1.5 m: arctan(L y / (L_a^2 - B y)), Table II's 56.9 degrees."""
    expected = math.atan(1.17 * 1.5 / (1.5**2 - 0.74 * 1.5))
    outcome = drive(Trial(STRAIGHT, IDEAL, PLAIN))
    assert outcome.inner_rad == pytest.approx(expected, abs=1e-6)
    assert math.degrees(outcome.inner_rad) == pytest.approx(56.9, abs=0.2)


def test_what_is_kept_is_what_was_measured():
    outcome = drive(Trial(STRAIGHT, PROMPT, OURS))
    assert outcome.t[0] == 0.0
    assert outcome.t[-1] == pytest.approx(25.0, abs=0.11)
    assert outcome.xy[0] == pytest.approx((0.0, 1.5))
    assert outcome.lateral_m == pytest.approx(outcome.xy[:, 1], abs=1e-9)
    mean = np.trapezoid(np.abs(outcome.lateral_m), outcome.t) / outcome.t[-1]
    assert outcome.mean_m == pytest.approx(mean, abs=2e-3)
    assert outcome.mean_m == pytest.approx(outcome.settling.mean_25_s_m, abs=1e-3)
    outside = np.flatnonzero(np.abs(outcome.lateral_m) > 0.05)
    assert outcome.settling.time_s == pytest.approx(outcome.t[outside[-1]], abs=0.11)


def test_a_contender_who_is_told_the_delay_of_command_or_pose_returns_as_without():
    """A late pose is carried on by the wheels; the prediction takes out the commands' delay, but for their wait."""
    prompt, pose, command = (drive(Trial(STRAIGHT, plant, OURS_TOLD)) for plant in (PROMPT, LATE_POSE, LATE_COMMAND))
    assert (pose.delay_s, command.delay_s) == (0.0, pytest.approx(0.6))
    assert pose.settling.mean_25_s_m == pytest.approx(prompt.settling.mean_25_s_m, abs=0.002)
    assert command.settling.mean_25_s_m == pytest.approx(prompt.settling.mean_25_s_m + 0.6 * 1.5 / 25.0, abs=0.002)
    assert command.settling.time_s == pytest.approx(prompt.settling.time_s + 0.6, abs=0.05)


@pytest.mark.parametrize(("plant", "delay_s"), [(PROMPT, 0.0), (LATE_POSE, 0.0), (LATE_COMMAND, 0.6)])
def test_the_delay_of_the_commands_is_learnt_on_the_way_and_that_of_the_pose_does_not_mislead(plant, delay_s):
    outcome = drive(Trial(STRAIGHT, plant, OURS))
    assert outcome.delay_s == pytest.approx(delay_s, abs=0.1)
    assert drive(Trial(STRAIGHT, plant, PLAIN)).delay_s == 0.0


def test_a_curve_is_driven_to_its_goal_and_every_time_alike():
    trial = Trial("curve-right-angle", late_command(300_000_000), COMPENSATED)
    outcome = drive(trial)
    assert outcome.arrived
    assert outcome.settling.mean_after_m <= 0.02
    assert np.hypot(*(outcome.xy[0] - (0.0, 1.0))) == pytest.approx(0.0, abs=1e-9)
    assert pickle.dumps(drive(trial)[1:]) == pickle.dumps(outcome[1:])


def test_how_far_beyond_the_goal_a_vehicle_stops_is_no_error_across_the_path():
    """With late commands plain pursuit passes the goal of the straight last stretch by a tenth of a metre."""
    outcome = drive(Trial("curve-right-angle", LATE_COMMAND, PLAIN))
    assert outcome.arrived
    assert np.abs(outcome.lateral_m[-20:]).max() <= 0.01


def test_who_does_not_reach_the_goal_in_time_is_said_not_to(monkeypatch):
    monkeypatch.setattr("sim_bridge.scenario.TIME_FACTOR", 0.3)
    outcome = drive(Trial("curve-u", PROMPT, PLAIN))
    assert not outcome.arrived
    assert outcome.t[-1] < 25.0


@pytest.mark.parametrize("contender", CONTENDERS, ids=lambda contender: contender.name)
def test_every_contender_is_a_controller_of_the_vehicle_told_of_its_steering(contender):
    for plant in (PLANTS[IDEAL], PLANTS[PROMPT]):
        config = configuration(contender, plant.steering_rate_radps, 0.0)
        assert config.variant.controller == contender.controller
        assert policy_of(config) is not None
        known = min(plant.steering_rate_radps, 20.0)
        assert config.tracker.following.answer.rate_radps == pytest.approx(known)
        assert config.tracker.following.answer.lag_s == 0.0
        assert config.controllers.mpc.rate_radps == pytest.approx(known)


def test_names_tell_contenders_apart_and_everything_is_tried_once():
    assert len({contender.name for contender in (*GAINS, *CONTENDERS)}) == len(GAINS) + len(CONTENDERS) - 2
    keys = [(trial.course, trial.plant, trial.contender.name) for trial in all_trials()]
    assert len(set(keys)) == len(keys)
    straights = (len(GAINS) + len(CONTENDERS) - 2) * len(PLANTS)
    assert len(keys) == straights + len(CONTENDERS) * len(PLANTS) * len(SHAPES)
    assert {contender.delay for contender in CONTENDERS} == set(DelayHandling)
