# SPDX-License-Identifier: Apache-2.0
"""The experiments' figures in tables, the paper's beside ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from sim_bridge.paper_002.claims import Claim
from sim_bridge.paper_002.contenders import COMPENSATED, CONTENDERS, GAINS, OURS, PLAIN, Contender
from sim_bridge.paper_002.plants import DELAYS_NS, PLANTS, WORST, late_command
from sim_bridge.paper_002.printed import CURVE_MEAN_M, CURVE_RATIO, TABLE_II
from sim_bridge.paper_002.results import SHAPES, Results
from sim_bridge.paper_002.trial import Outcome

Cell = Callable[[str, Contender], str]


class Table(NamedTuple):
    """Rows of text below a header; the first column names the row."""

    title: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


def kinematic_tables(results: Results) -> list[Table]:
    """Those of the kinematic plants."""
    return [
        table_ii(results),
        straight_in_detail(results),
        _by_plant(
            "Straight on every plant: mean error over 25 s (m), settled after (s), overshoot (m)",
            lambda plant, who: _straight_cell(results.straight(plant, who)),
        ),
        _by_plant(
            "Curves after the first 12 s: mean error over the five shapes, m, and of how many the goal was not reached",
            lambda plant, who: _curve_cell(results, plant, who),
        ),
        _by_plant(
            f"Curves after the first 12 s: ratio to plain pure pursuit (the paper's figures: {CURVE_RATIO:.2f})",
            lambda plant, who: number(results.ratio(plant, who), 2),
        ),
        _whole(results),
        by_shape(results),
    ]


def table_ii(results: Results) -> Table:
    """Table II on every plant."""
    rows = []
    for plant in PLANTS:
        for contender in GAINS:
            outcome, printed = results.straight(plant, contender), TABLE_II[contender.name]
            settling = outcome.settling
            rows.append(
                (
                    plant,
                    contender.name,
                    number(settling.mean_25_s_m, 3),
                    number(printed.mean_m, 3),
                    number(settling.time_s, 1),
                    number(printed.settled_s, 1),
                    number(math.degrees(outcome.inner_rad), 1),
                    number(printed.inner_deg, 1),
                    number(settling.overshoot_m, 2),
                )
            )
    header = ("plant", "method", "error m", "paper", "settled s", "paper", "inner deg", "paper", "overshoot m")
    return Table(
        "Table II: straight, from 1.5 m beside it at 0.6 m/s: mean error over 25 s, steady time, largest inner angle",
        header,
        rows,
    )


def straight_in_detail(results: Results) -> Table:
    """All contenders on the plant of the claims."""
    rows = []
    for contender in CONTENDERS:
        outcome = results.straight(WORST, contender)
        settling = outcome.settling
        rows.append(
            (
                contender.name,
                number(settling.mean_25_s_m, 3),
                number(settling.time_s, 1),
                number(settling.overshoot_m, 3),
                number(math.degrees(outcome.inner_rad), 1),
                number(results.inner_ratio(WORST, contender), 2),
                number(outcome.delay_s, 2),
            )
        )
    header = ("method", "error m", "settled s", "overshoot m", "inner deg", "to plain's", "delay s")
    return Table(f"Straight, {WORST}: all methods, and what they took the delay for in the end", header, rows)


def by_shape(results: Results) -> Table:
    """Each shape apart, where the mean over them hides something."""
    rows = []
    for delay_ns in (0, *DELAYS_NS):
        plant = late_command(delay_ns)
        for contender in (PLAIN, COMPENSATED, OURS):
            errors = [outcome.settling.mean_after_m for outcome in results.curves(plant, contender)]
            rows.append((plant, contender.name, *(number(error, 4) for error in errors)))
    header = ("plant", "method", *SHAPES.values())
    return Table("Curves after the first 12 s, shape by shape: mean error, m", header, rows)


def claim_table(made: Sequence[Claim]) -> Table:
    """Every claim with its verdict."""
    rows = [_claim_row(claim) for claim in made]
    return Table("Claims", ("claim", "measured", "at least", "aim", "paper", ""), rows)


def _claim_row(claim: Claim) -> tuple[str, ...]:
    paper = "-" if claim.paper is None else number(claim.paper, 3)
    return claim.what, number(claim.measured, 4), f"{claim.at_least:g}", f"{claim.aim:g}", paper, claim.verdict


def _whole(results: Results) -> Table:
    table = _by_plant(
        "Curves, start from 1 m beside the path included: mean error over the five shapes, m",
        lambda plant, who: number(results.whole_m(plant, who), 3),
    )
    papers = [number(CURVE_MEAN_M.get(contender.name, math.nan), 3) for contender in CONTENDERS]
    rows = [(*row, paper) for row, paper in zip(table.rows, papers, strict=True)]
    return Table(table.title, (*table.header, "paper"), rows)


def _by_plant(title: str, cell: Cell) -> Table:
    rows = [(contender.name, *(cell(plant, contender) for plant in PLANTS)) for contender in CONTENDERS]
    return Table(title, ("method", *PLANTS), rows)


def _straight_cell(outcome: Outcome) -> str:
    settling = outcome.settling
    return " ".join((number(settling.mean_25_s_m, 3), number(settling.time_s, 1), number(settling.overshoot_m, 2)))


def _curve_cell(results: Results, plant: str, contender: Contender) -> str:
    lost = len(SHAPES) - results.arrived(plant, contender)
    return number(results.after_m(plant, contender), 4) + (f", {lost} not" if lost else "")


def number(value: float, digits: int) -> str:
    """With so many digits after the point; a dash for what there is none of."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
