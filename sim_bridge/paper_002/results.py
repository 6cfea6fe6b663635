# SPDX-License-Identifier: Apache-2.0
"""The outcomes of all trials, and the figures that are made of several of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean

from runtime.tracking.bends import CURVES
from sim_bridge.paper_002.contenders import CONTENDERS, GAINS, PLAIN, Contender
from sim_bridge.paper_002.plants import PLANTS
from sim_bridge.paper_002.trial import STRAIGHT, Outcome, Trial

SHAPES = {f"curve-{shape}": shape for shape in CURVES}
"""Courses of the curve experiment, and the names of their shapes."""


def all_trials() -> list[Trial]:
    """Every contender on every course and plant, and the paper's gains on the straight."""
    curves = [Trial(course, plant, contender) for course in SHAPES for plant in PLANTS for contender in CONTENDERS]
    everyone = {contender.name: contender for contender in (*GAINS, *CONTENDERS)}.values()
    return [Trial(STRAIGHT, plant, contender) for plant in PLANTS for contender in everyone] + curves


class Results:
    """Outcomes, by course, plant and contender."""

    def __init__(self, outcomes: Iterable[Outcome]) -> None:
        self._outcomes = {self._key(*outcome.trial): outcome for outcome in outcomes}

    @staticmethod
    def _key(course: str, plant: str, contender: Contender) -> tuple[str, str, str]:
        return course, plant, contender.name

    def of(self, course: str, plant: str, contender: Contender) -> Outcome:
        """That of one trial."""
        return self._outcomes[self._key(course, plant, contender)]

    def straight(self, plant: str, contender: Contender) -> Outcome:
        """That on the straight."""
        return self.of(STRAIGHT, plant, contender)

    def curves(self, plant: str, contender: Contender) -> Sequence[Outcome]:
        """Those on the five shapes."""
        return [self.of(course, plant, contender) for course in SHAPES]

    def after_m(self, plant: str, contender: Contender) -> float:
        """Mean error on the shapes after the first 12 s, each shape counting alike."""
        return fmean(outcome.settling.mean_after_m for outcome in self.curves(plant, contender))

    def whole_m(self, plant: str, contender: Contender) -> float:
        """Mean error on the shapes, start included."""
        return fmean(outcome.mean_m for outcome in self.curves(plant, contender))

    def arrived(self, plant: str, contender: Contender) -> int:
        """On how many shapes the contender came to the goal."""
        return sum(outcome.arrived for outcome in self.curves(plant, contender))

    def ratio(self, plant: str, contender: Contender) -> float:
        """Of the mean error on the shapes after the first 12 s to that of plain pure pursuit."""
        return self.after_m(plant, contender) / self.after_m(plant, PLAIN)

    def inner_ratio(self, plant: str, contender: Contender) -> float:
        """Of the largest inner steering angle on the straight to that of plain pure pursuit."""
        return self.straight(plant, contender).inner_rad / self.straight(plant, PLAIN).inner_rad
