# SPDX-License-Identifier: Apache-2.0
"""Trajectories and errors of the simulated vehicle, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from runtime.recording.figure_style import BLUE, GREEN, INK, ORANGE, STYLE, ReportFigure, line, svg
from runtime.recording.settling import WINDOW_S
from sim_bridge.paper_002.trial import STRAIGHT
from sim_bridge.paper_002.vehicle_drive import Driven, Track
from sim_bridge.vehicle_courses import scenario

COLORS = (BLUE, ORANGE, GREEN)


def vehicle_pictures(outcomes: Sequence[Driven]) -> list[ReportFigure]:
    """One of each course of which tracks were kept."""
    courses = dict.fromkeys(outcome.drive.scenario for outcome in outcomes if outcome.track is not None)
    with mpl.rc_context(STYLE):
        return [_course(course, [one for one in outcomes if one.drive.scenario == course]) for course in courses]


def _course(course: str, outcomes: Sequence[Driven]) -> ReportFigure:
    """Where they drove, and how far from the path, over time."""
    shown = [(outcome.drive, outcome.track) for outcome in outcomes if outcome.track is not None]
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1)
    path = np.array(scenario(course).waypoints)
    above.plot(*path.T, color=INK, linewidth=2.2, linestyle=(0, (4, 2)), label="path")
    for (drive, track), color in zip(shown, COLORS, strict=True):
        xy, lateral_m = _window(course, track)
        above.plot(*xy.T, color=color, label=drive.contender.name)
        line(below, track.t[: len(lateral_m)], lateral_m, drive.contender.name, color)
    above.set(xlabel="x (m)", ylabel="y (m)")
    if course != STRAIGHT:
        above.set_aspect("equal")
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    below.set(xlabel="time since it moves (s)", ylabel="lateral error (m)")
    plant = shown[0][0].plant
    return ReportFigure(
        f"The simulated vehicle (MuJoCo) on {course}, {plant}",
        "From beside the path, at rest: trajectories of the true centre, and its error over time.",
        svg(figure),
    )


def _window(course: str, track: Track) -> tuple[np.ndarray, np.ndarray]:
    """Positions and errors that are drawn: on the straight, those of the paper's window."""
    count = int(np.searchsorted(track.t, WINDOW_S)) if course == STRAIGHT else len(track.t)
    return track.xy[:count], track.lateral_m[:count]
