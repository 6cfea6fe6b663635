# SPDX-License-Identifier: Apache-2.0
"""A spread is where one more figure would lie, however few there are to say so."""

import math
import random

import pytest

from runtime.recording.spread import CONFIDENCE, spread_of


def test_the_interval_is_that_of_the_textbook():
    spread = spread_of([9.0, 10.0, 11.0])
    assert (spread.least, spread.most) == (9.0, 11.0)
    reach = 9.9248432 * 1.0 * math.sqrt(4.0 / 3.0)  # Student's t for 99 %, two degrees of freedom
    assert (spread.low, spread.high) == (pytest.approx(10.0 - reach), pytest.approx(10.0 + reach))


@pytest.mark.parametrize("count", [3, 8, 20])
def test_one_more_figure_lies_within_as_often_as_is_said(count):
    draw = random.Random(count)
    trials = 2000
    inside = sum(
        spread_of([draw.gauss(5.0, 2.0) for _ in range(count)]).holds(draw.gauss(5.0, 2.0)) for _ in range(trials)
    )
    deviation = math.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / trials)
    assert inside / trials == pytest.approx(CONFIDENCE, abs=4.0 * deviation)


def test_it_holds_every_figure_that_it_is_made_of():
    figures = [0.0] * 30 + [100.0]
    spread = spread_of(figures)
    assert all(map(spread.holds, figures))
    assert not spread.holds(100.1)
    assert not spread.holds(math.nan)


def test_figures_that_are_all_alike_have_no_width_but_their_resolution():
    alike = [1.0, 1.0, 1.0]
    assert spread_of(alike).holds(1.0)
    assert not spread_of(alike).holds(1.001)
    assert spread_of(alike, 0.01).holds(1.009)
    assert not spread_of(alike, 0.01).holds(1.011)


def test_one_figure_has_no_spread():
    with pytest.raises(ValueError, match="1 figures have no spread"):
        spread_of([1.0])
