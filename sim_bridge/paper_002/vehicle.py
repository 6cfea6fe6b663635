# SPDX-License-Identifier: Apache-2.0
"""The same comparison on the simulated vehicle: physics, wires, estimator and all; from a standing start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from math import nan
from statistics import fmean
from typing import Any, NamedTuple

from runtime.robots import load_configuration
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from sim_bridge.paper_002.claims import Claim
from sim_bridge.paper_002.contenders import (
    COMPENSATED,
    CONTENDERS,
    OURS,
    PAPERS,
    PLAIN,
    ROBOT,
    Contender,
    DelayHandling,
    steering_settings,
)
from sim_bridge.paper_002.plants import DELAYS_NS, PLANTS, PROMPT, STEERING_RATE_RADPS, WORST, late_command, late_pose
from sim_bridge.paper_002.results import SHAPES
from sim_bridge.paper_002.tables import Table, number
from sim_bridge.paper_002.trial import STRAIGHT

Summary = Mapping[str, Any]
Summaries = Mapping[tuple[str, int], Summary]
"""By scenario and seed."""
LATEST_ANSWER_NS = 1_500_000_000
"""Longer than any delay here: a wheel that answers late is not stuck, nor does a unit that does so refuse."""
UNLEARNT = {"delay.initial_s": "0.0", "delay.maximum_s": "0.0"}
"""Predicts over no delay, and learns none."""
DRIVEN_PLANTS = (PROMPT, *(late(delay) for late in (late_command, late_pose) for delay in DELAYS_NS))
FEW_PLANTS, FEW_CONTENDERS, FEW_SCENARIOS = (PROMPT, WORST), (PLAIN, PAPERS, COMPENSATED, OURS), (STRAIGHT, "curve-s")


class Drive(NamedTuple):
    """A run of the vehicle.

    Attributes:
        scenario: of the vehicle.
        plant: name of one of `PLANTS`, whose delays and steering rate the simulated vehicle has.
        contender: who drives.
        seed: of every noise.
    """

    scenario: str
    plant: str
    contender: Contender
    seed: int


def driven_contenders() -> list[Contender]:
    """Those that the vehicle can have: it tells nobody its delay, and pure pursuit learns none."""
    return [
        contender
        for contender in CONTENDERS
        if contender.delay is not DelayHandling.KNOWN
        and (contender.controller != PLAIN.controller or contender.delay is DelayHandling.IGNORED)
    ]


def all_drives(seeds: int) -> list[Drive]:
    """Every contender on the straight and on every shape."""
    return [
        Drive(scenario, plant, contender, seed)
        for scenario in (STRAIGHT, *SHAPES)
        for plant in DRIVEN_PLANTS
        for contender in driven_contenders()
        for seed in range(seeds)
    ]


def few_drives(seeds: int) -> list[Drive]:
    """Those of all drives that tell most: of the methods that are spoken of, without delay and with the longest."""
    return [
        drive
        for drive in all_drives(seeds)
        if drive.plant in FEW_PLANTS and drive.contender in FEW_CONTENDERS and drive.scenario in FEW_SCENARIOS
    ]


def settings_of(drive: Drive) -> dict[str, str]:
    """Configuration keys and values that give the vehicle the delays of the plant, and the controllers its steering."""
    plant, contender = PLANTS[drive.plant], drive.contender
    settings = {
        **steering_settings(STEERING_RATE_RADPS, _steering_lag_s()),
        "simulation.center_rate_radps": repr(STEERING_RATE_RADPS),
        "simulation.command_delay_ns": str(plant.command_delay_ns),
        "safety.steering_stuck_ns": str(LATEST_ANSWER_NS),
        "safety.refusal_ns": str(LATEST_ANSWER_NS),
    }
    if plant.pose_delay_ns:
        settings["simulation.localization_latency_ns"] = str(plant.pose_delay_ns)
    if contender.delay is DelayHandling.IGNORED:
        settings |= UNLEARNT
    return {**settings, **contender.settings}


@cache
def _steering_lag_s() -> float:
    """Of the simulated vehicle."""
    config = load_configuration(ROBOT)
    assert isinstance(config, Vehicle4ws4wdConfig)
    return config.simulation.steering_lag_s


def vehicle_table(driven: Sequence[tuple[Drive, Summary]]) -> Table:
    """What came of the drives that were completed: the mean over seeds, and over the shapes; and how many were."""
    rows = []
    for plant, contender in dict.fromkeys((drive.plant, drive.contender.name) for drive, _ in driven):
        straight, curves, plain = (
            {
                (drive.scenario, drive.seed): summary
                for drive, summary in driven
                if (drive.plant, drive.contender.name) == (plant, name) and (drive.scenario == STRAIGHT) == is_straight
            }
            for name, is_straight in ((contender, True), (contender, False), (PLAIN.name, False))
        )
        rows.append(
            (
                plant,
                contender,
                _completed(straight),
                number(_mean(straight, "mean_25_s_m"), 3),
                number(_mean(straight, "time_s"), 1),
                number(_mean(straight, "overshoot_m"), 3),
                _completed(curves),
                number(_mean(curves, "mean_after_m"), 4),
                number(_ratio(curves, plain), 2),
            )
        )
    header = ("plant", "method", "straight", "error m", "settled s", "overshoot m", "curves", "error m", "to plain's")
    return Table(
        "The simulated vehicle (MuJoCo), from a standing start; curves after the first 12 s; means over the completed "
        "drives, ratios over those that pure pursuit completed too",
        header,
        rows,
    )


def vehicle_claims(driven: Sequence[tuple[Drive, Summary]]) -> list[Claim]:
    """That ours completes every drive; the vehicle's default controller beside."""
    return [_lost(driven, OURS, decides=True), _lost(driven, COMPENSATED, decides=False)]


def _lost(driven: Sequence[tuple[Drive, Summary]], contender: Contender, decides: bool) -> Claim:
    completed = [_is_completed(summary) for drive, summary in driven if drive.contender == contender]
    what = f"MuJoCo, {contender.name}: drives of {len(completed)} that were not completed"
    return Claim(what, completed.count(False) if completed else nan, 0, 0, decides=decides)


def _is_completed(summary: Summary) -> bool:
    return bool(summary["completed"])


def _completed(summaries: Summaries) -> str:
    return f"{sum(map(_is_completed, summaries.values()))} of {len(summaries)}"


def _figures(summaries: Summaries, key: str) -> dict[tuple[str, int], float]:
    """A figure of settling of the drives that were completed; NaN of one that has none."""
    figures = {which: one["settling"][key] for which, one in summaries.items() if _is_completed(one)}
    return {which: nan if figure is None else figure for which, figure in figures.items()}


def _mean(summaries: Summaries, key: str) -> float:
    """Mean of a figure over the drives that were completed; NaN if there are none, or one has no such figure."""
    figures = _figures(summaries, key)
    return fmean(figures.values()) if figures else nan


def _ratio(summaries: Summaries, others: Summaries) -> float:
    """Of the errors on the courses that both completed."""
    ours, theirs = (_figures(of, "mean_after_m") for of in (summaries, others))
    both = ours.keys() & theirs.keys()
    return fmean(ours[which] for which in both) / fmean(theirs[which] for which in both) if both else nan
