# SPDX-License-Identifier: Apache-2.0
"""The figure of a real-time run's wakes: how late each tick began, and where ticks are missing or were skipped."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from runtime.recording.figure_style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    VIOLET,
    ReportFigure,
    legend,
    svg,
    thinned,
)
from runtime.recording.run_data import RunData

_LEAST_US = 1.0


def wake_figure(data: RunData) -> ReportFigure | None:
    """Of the loops that woke on the wall clock; None in virtual time."""
    shown = [one for one in data.loop_times if one.wake is not None]
    if not shown:
        return None
    figure = Figure(figsize=(9.6, 2.1 * len(shown) + 0.2), layout="constrained")
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(3, 2))
    for row, (one, color) in enumerate(zip(shown, (BLUE, ORANGE, GREEN, VIOLET) * len(shown), strict=False)):
        ticks = data.ticks[one.loop.name]
        late_us = np.maximum(ticks.values["wake_latency_ns"] / 1e3, _LEAST_US)
        t = ticks.log_ns / 1e9
        wake, share = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        wake.plot(*thinned(t, late_us), ".", color=color, markersize=2.0, label=one.loop.name)
        wake.set(yscale="log", ylabel="wake latency (us)", xlabel="time (s)" if row == len(shown) - 1 else "")
        wake.axhline(one.loop.period_ns / 1e3, color=RED, linewidth=1.0, linestyle="--", label="one period")
        skipped = ticks.values["skipped"] > 0
        if skipped.any():
            wake.plot(t[skipped], late_us[skipped], "|", color=INK, markersize=9, label="periods skipped before")
        for number, gap in enumerate(one.gaps):
            wake.axvspan(
                gap.begin_ns / 1e9,
                gap.end_ns / 1e9,
                color=RED,
                alpha=0.25,
                linewidth=1,
                label=None if number else "missing",
            )
        legend(wake)
        ordered = np.sort(late_us)
        share.plot(ordered, 1.0 - np.arange(len(ordered)) / len(ordered), color=color)
        share.axvline(one.loop.period_ns / 1e3, color=RED, linewidth=1.0, linestyle="--")
        share.set(xscale="log", yscale="log", ylabel="share later")
        share.set_xlabel("wake latency (us)" if row == len(shown) - 1 else "")
        for part, name in ((0.01, "p99"), (0.001, "p99.9")):
            share.axhline(part, color=FAINT, linewidth=0.7, linestyle=":")
            share.text(0.995, part, name, transform=share.get_yaxis_transform(), ha="right", va="bottom", fontsize=7.5)
    return ReportFigure(
        "Wakes",
        "How long after its release each tick began, and the share of ticks that began later than a time.",
        svg(figure),
    )
