# SPDX-License-Identifier: Apache-2.0
"""Outcomes as the paper prints them, of every trial, and changes to them."""

import math

import numpy as np
import pytest

from runtime.recording.settling import Settling
from sim_bridge.paper_002.printed import CURVE_MEAN_M, TABLE_II, Printed
from sim_bridge.paper_002.results import Results, all_trials
from sim_bridge.paper_002.trial import Outcome

OTHERS = Printed(0.22, 7.0, 22.0)
OTHERS_ON_CURVES_M = 0.04


def printed_outcome(trial):
    """What the paper prints, and for the methods that it does not know something better."""
    straight = TABLE_II.get(trial.contender.name, OTHERS)
    curve_m = CURVE_MEAN_M.get(trial.contender.name, OTHERS_ON_CURVES_M)
    t = np.arange(0.0, 25.0, 0.1)
    return Outcome(
        trial,
        arrived=True,
        mean_m=2.0 * curve_m,
        settling=Settling(straight.settled_s, 0.02, straight.mean_m, 0.4, curve_m),
        inner_rad=math.radians(straight.inner_deg),
        delay_s=0.0,
        t=t,
        xy=np.column_stack((0.6 * t, 1.5 * np.exp(-t))),
        lateral_m=1.5 * np.exp(-t),
    )


@pytest.fixture
def printed_results():
    """Makes the results, each outcome changed as a function of it says."""

    def make(change=lambda outcome: outcome):
        return Results(change(printed_outcome(trial)) for trial in all_trials())

    return make
