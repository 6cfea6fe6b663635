# SPDX-License-Identifier: Apache-2.0
"""What is claimed of the vehicle's own controllers, beside what was measured and what the paper prints."""

from __future__ import annotations

from typing import NamedTuple

from sim_bridge.paper_002.contenders import COMPENSATED, FUZZY, GAINS, OURS, PAPERS, Contender
from sim_bridge.paper_002.plants import DELAYS_NS, WORST, late_command
from sim_bridge.paper_002.printed import CURVE_MEAN_M, CURVE_RATIO, INNER_RATIO, TABLE_II
from sim_bridge.paper_002.results import Results

BEST_GAIN = GAINS[2]


class Claim(NamedTuple):
    """A figure and its bounds, which are the largest that keep them.

    Attributes:
        what: is measured.
        measured: NaN where there is no such figure, which keeps nothing.
        at_least: the bound that has to be kept.
        aim: what it should become.
        paper: what the paper prints, if anything.
        decides: false for figures that are listed beside.
    """

    what: str
    measured: float
    at_least: float
    aim: float
    paper: float | None = None
    decides: bool = True

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if not self.decides:
            return "beside" if self.kept else "beside: above"
        if self.measured <= self.aim:
            return "aim met"
        return "kept" if self.kept else "MISSED"

    @property
    def kept(self) -> bool:
        """Whether the bound is kept."""
        return self.measured <= self.at_least


def claims(results: Results) -> list[Claim]:
    """All of them."""
    table = [*_of_the_straight(results, OURS, decides=True), *_of_the_straight(results, COMPENSATED, decides=False)]
    for contender in (COMPENSATED, OURS, FUZZY, PAPERS):
        table += _of_curves(results, contender, decides=contender in (COMPENSATED, OURS))
    return table


def _of_the_straight(results: Results, contender: Contender, decides: bool) -> list[Claim]:
    what, paper = f"straight, {WORST}, {contender.name}", TABLE_II[BEST_GAIN.name]
    settling, inner = results.straight(WORST, contender).settling, results.inner_ratio(WORST, contender)
    return [
        Claim(f"{what}: mean error over 25 s, m", settling.mean_25_s_m, 0.25, 0.235, paper.mean_m, decides),
        Claim(f"{what}: settled to 5 cm after, s", settling.time_s, 9.5, 8.0, paper.settled_s, decides),
        Claim(f"{what}: overshoot, m", settling.overshoot_m, 0.09, 0.05, None, decides),
        Claim(f"{what}: largest inner angle, to plain pursuit's", inner, 0.53, 0.4, INNER_RATIO, decides),
    ]


def _of_curves(results: Results, contender: Contender, decides: bool) -> list[Claim]:
    table = []
    for delay_ns in (0, *DELAYS_NS):
        plant = late_command(delay_ns)
        what = f"curves, {plant}, {contender.name}"
        worst = max(outcome.settling.mean_after_m for outcome in results.curves(plant, contender))
        table += [
            Claim(
                f"{what}: mean error after 12 s, worst shape, m", worst, 0.085, 0.05, CURVE_MEAN_M[PAPERS.name], decides
            ),
            Claim(f"{what}: ratio to plain pursuit", results.ratio(plant, contender), 0.8, 0.6, CURVE_RATIO, decides),
        ]
    return table
