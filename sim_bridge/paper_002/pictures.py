# SPDX-License-Identifier: Apache-2.0
"""Trajectories and errors, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from runtime.recording.figure_style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    STYLE,
    VIOLET,
    ReportFigure,
    line,
    svg,
)
from runtime.recording.settling import APPROACH_S
from sim_bridge.paper_002.contenders import COMPENSATED, CONTENDERS, GAINS, OURS, PAPERS, PLAIN, Contender
from sim_bridge.paper_002.plants import DELAYS_NS, IDEAL, PROMPT, WORST, late_command, late_pose
from sim_bridge.paper_002.results import SHAPES, Results
from sim_bridge.paper_002.trial import Outcome
from sim_bridge.vehicle_courses import scenario

COLORS = (BLUE, ORANGE, GREEN, RED, VIOLET, INK)
PREDICTIVE = next(contender for contender in CONTENDERS if contender.controller == "mpc")
SHOWN = (PLAIN, PAPERS, COMPENSATED, PREDICTIVE, OURS)
LINEAR_M, ERROR_TICKS_M = 0.1, (-1.0, -0.1, -0.05, 0.0, 0.05, 0.1, 1.0)
"""Errors on curves are drawn on a scale that is logarithmic beyond the first of these."""
SHOWN_LENGTH_M = 10.0
"""Of the straight: beyond it all are on the line, or will not be."""
STRAIGHT_PLANTS = (IDEAL, PROMPT, late_pose(DELAYS_NS[-1]), WORST)
CURVE_PLANTS = (PROMPT, *(late(delay) for late in (late_pose, late_command) for delay in DELAYS_NS))


def pictures(results: Results) -> list[ReportFigure]:
    """All of them."""
    with mpl.rc_context(STYLE):
        return [
            *(_straight(results, plant, GAINS, "the paper's gains") for plant in STRAIGHT_PLANTS),
            _straight(results, WORST, SHOWN, "methods"),
            *(_curves(results, plant) for plant in CURVE_PLANTS),
        ]


def _straight(results: Results, plant: str, contenders: Sequence[Contender], what: str) -> ReportFigure:
    """Where they drove, and how far from the line, over time."""
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1)
    above.plot((0.0, SHOWN_LENGTH_M), (0.0, 0.0), color=INK, linewidth=2.2, linestyle=(0, (4, 2)), label="path")
    for contender, color in zip(contenders, COLORS, strict=False):
        outcome = results.straight(plant, contender)
        near = outcome.xy[:, 0] <= SHOWN_LENGTH_M
        above.plot(*outcome.xy[near].T, color=color, label=contender.name)
        _error(below, outcome, contender, color)
    above.set(xlabel="x (m)", ylabel="y (m)")
    above.legend(loc="upper right", ncols=2)
    below.set(xlabel="time (s)", ylabel="lateral error (m)")
    return ReportFigure(
        f"Straight, {plant}: {what}",
        "From 1.5 m beside the line at 0.6 m/s: trajectories, and error over time.",
        svg(figure),
    )


def _curves(results: Results, plant: str) -> ReportFigure:
    """The five shapes below one another."""
    figure = Figure(figsize=(9.6, 2.9 * len(SHAPES)), layout="constrained")
    grid = figure.subplots(len(SHAPES), 2)
    for (course, shape), (left, right) in zip(SHAPES.items(), grid, strict=True):
        path = np.array(scenario(course).waypoints)
        left.plot(*path.T, color=INK, linewidth=2.2, linestyle=(0, (4, 2)))
        for contender, color in zip(SHOWN, COLORS, strict=False):
            outcome = results.of(course, plant, contender)
            left.plot(*outcome.xy.T, color=color)
            _error(right, outcome, contender, color)
        margin = 1.5
        left.set(
            aspect="equal",
            ylabel="y (m)",
            title=shape,
            xlim=(path[:, 0].min() - margin, path[:, 0].max() + margin),
            ylim=(path[:, 1].min() - margin, path[:, 1].max() + margin),
        )
        right.axvline(APPROACH_S, color=FAINT, linewidth=0.8)
        right.set_yscale("symlog", linthresh=LINEAR_M)
        right.set(ylabel="lateral error (m)", ylim=(-2.0, 2.0), yticks=ERROR_TICKS_M, yticklabels=ERROR_TICKS_M)
    grid[-1][0].set_xlabel("x (m)")
    grid[-1][1].set_xlabel("time (s)")
    figure.legend(*grid[0][1].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return ReportFigure(
        f"Curves, {plant}",
        "From 1 m beside each path at 0.6 m/s; the vertical line divides the first 12 s from the rest, and errors "
        "beyond 0.1 m are drawn on a logarithmic scale.",
        svg(figure),
    )


def _error(axes: Axes, outcome: Outcome, contender: Contender, color: str) -> None:
    line(axes, outcome.t, outcome.lateral_m, contender.name, color)
