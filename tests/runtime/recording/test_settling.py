# SPDX-License-Identifier: Apache-2.0
"""How a vehicle came to its path, and how it turned, judged on motions whose answer is known."""

import math

import numpy as np
import pytest

from runtime.recording.settling import settling, turn_in_place
from runtime.tracking.paths import Polyline

LINE = Polyline([(0.0, 0.0), (40.0, 0.0)])
T = np.arange(0.0, 30.0, 0.01)


def beside(y):
    return np.stack((0.6 * T, y), axis=1)


def test_an_exponential_return_settles_when_its_formula_says():
    judged = settling(T, beside(1.5 * np.exp(-T / 2.0)), LINE)
    assert judged.time_s == pytest.approx(2.0 * math.log(1.5 / 0.05), abs=0.05)
    assert judged.overshoot_m == pytest.approx(0.0, abs=1e-9)
    assert judged.mean_25_s_m == pytest.approx(1.5 * 2.0 / 25.0, rel=0.02)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_overshoot_is_on_the_other_side_whichever_that_is(side):
    judged = settling(T, beside(side * 1.5 * np.exp(-T / 3.0) * np.cos(T)), LINE)
    crest = math.pi - math.atan(1.0 / 3.0)
    assert judged.overshoot_m == pytest.approx(-1.5 * math.exp(-crest / 3.0) * math.cos(crest), abs=0.01)


def test_one_that_stays_beside_the_path_never_settles():
    summary = settling(T, beside(np.full(len(T), 0.2)), LINE).summary()
    assert summary["time_s"] is None
    assert summary["mean_after_m"] == pytest.approx(0.2)


def test_one_that_never_moves_has_no_figures():
    still = np.zeros((len(T), 2))
    assert set(settling(T, still, LINE).summary().values()) == {None}


@pytest.mark.parametrize("turns", [0.25, 1.0, -2.0])
def test_a_turn_in_place_counts_whole_turns(turns):
    yaw = np.angle(np.exp(1j * np.linspace(0.0, 2.0 * math.pi * turns, 500)))
    judged = turn_in_place(np.zeros((500, 2)), yaw, 2.0 * math.pi * turns)
    assert judged.completed
    assert judged.turned_rad == pytest.approx(2.0 * math.pi * turns)


def test_a_turn_that_wanders_off_is_none():
    xy = np.stack((np.linspace(0.0, 0.3, 500), np.zeros(500)), axis=1)
    assert not turn_in_place(xy, np.linspace(0.0, 1.0, 500), 1.0).completed
