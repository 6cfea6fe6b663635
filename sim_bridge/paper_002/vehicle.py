# SPDX-License-Identifier: Apache-2.0
"""The same comparison on the simulated vehicle: physics, wires, estimator and all; from a standing start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from statistics import fmean
from typing import Any, NamedTuple

from runtime.robots import load_configuration
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from sim_bridge.paper_002.contenders import CONTENDERS, PLAIN, ROBOT, Contender, DelayHandling, steering_settings
from sim_bridge.paper_002.plants import DELAYS_NS, PLANTS, PROMPT, STEERING_RATE_RADPS, late_command, late_pose
from sim_bridge.paper_002.results import SHAPES
from sim_bridge.paper_002.tables import Table, number
from sim_bridge.paper_002.trial import STRAIGHT

Summary = Mapping[str, Any]
LATEST_ANSWER_NS = 1_500_000_000
"""Longer than any delay here: a wheel that answers late is not stuck, nor does a unit that does so refuse."""
UNLEARNT = {"delay.initial_s": "0.0", "delay.rate_per_s": "1e-9"}
"""Predicts over no delay, and learns none."""
DRIVEN_PLANTS = (PROMPT, *(late_command(delay) for delay in DELAYS_NS), late_pose(DELAYS_NS[-1]))


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
    """What came of the drives: the mean over seeds, and over the shapes."""
    rows = []
    for plant in DRIVEN_PLANTS:
        of_plant = [(drive, summary) for drive, summary in driven if drive.plant == plant]
        plain = _mean([summary for drive, summary in of_plant if _is_curve(drive, PLAIN)], "mean_after_m")
        for contender in driven_contenders():
            straight = [
                summary
                for drive, summary in of_plant
                if drive.scenario == STRAIGHT and drive.contender.name == contender.name
            ]
            curves = [summary for drive, summary in of_plant if _is_curve(drive, contender)]
            error = _mean(curves, "mean_after_m")
            rows.append(
                (
                    plant,
                    contender.name,
                    _completed(straight),
                    number(_mean(straight, "mean_25_s_m"), 3),
                    number(_mean(straight, "time_s"), 1),
                    number(_mean(straight, "overshoot_m"), 3),
                    _completed(curves),
                    number(error, 4),
                    number(error / plain, 2),
                )
            )
    header = ("plant", "method", "straight", "error m", "settled s", "overshoot m", "curves", "error m", "to plain's")
    return Table("The simulated vehicle (MuJoCo), from a standing start; curves after the first 12 s", header, rows)


def _is_curve(drive: Drive, contender: Contender) -> bool:
    return drive.scenario in SHAPES and drive.contender.name == contender.name


def _completed(summaries: Sequence[Summary]) -> str:
    return f"{sum(bool(summary['completed']) for summary in summaries)} of {len(summaries)}"


def _mean(summaries: Sequence[Summary], key: str) -> float:
    """Mean of a figure of settling; NaN if a drive has none."""
    values = [summary.get("settling", {}).get(key) for summary in summaries]
    return fmean(values) if values and None not in values else float("nan")
