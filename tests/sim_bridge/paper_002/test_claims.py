# SPDX-License-Identifier: Apache-2.0
"""What is claimed of the vehicle's own controllers is driven, on the plant that is the hardest to drive."""

import pytest

from sim_bridge.paper_002.contenders import COMPENSATED, OURS, PLAIN
from sim_bridge.paper_002.plants import WORST
from sim_bridge.paper_002.trial import STRAIGHT, Trial, drive

SHAPES = ("curve-s", "curve-chicane")


@pytest.fixture(scope="module")
def plain():
    """What plain pursuit does there, by course."""
    return {course: drive(Trial(course, WORST, PLAIN)) for course in (STRAIGHT, *SHAPES)}


def test_ours_returns_to_a_line_with_commands_that_are_late(plain):
    outcome = drive(Trial(STRAIGHT, WORST, OURS))
    assert outcome.settling.mean_25_s_m <= 0.25
    assert outcome.settling.time_s <= 9.5
    assert outcome.settling.overshoot_m <= 0.09
    assert outcome.inner_rad / plain[STRAIGHT].inner_rad <= 0.53


@pytest.mark.parametrize("contender", [OURS, COMPENSATED], ids=lambda contender: contender.controller)
@pytest.mark.parametrize("shape", SHAPES)
def test_ours_and_the_papers_with_its_delay_learnt_keep_to_curves(plain, shape, contender):
    outcome = drive(Trial(shape, WORST, contender))
    assert outcome.arrived
    assert outcome.settling.mean_after_m <= 0.085
    assert outcome.settling.mean_after_m <= 0.8 * plain[shape].settling.mean_after_m
