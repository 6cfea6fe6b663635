# SPDX-License-Identifier: Apache-2.0
"""How the report's figures look, and what they have in common.

Lines are drawn from at most a couple of thousand points: within each column of the picture the extremes are kept, so no
peak is lost.
"""

from __future__ import annotations

import io
from html import escape
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from runtime.recording.run_data import Array

COLUMNS = 600
INK, FAINT = "#1d2733", "#8a97a6"
BLUE, ORANGE, GREEN, RED, VIOLET = "#2166c2", "#e07b00", "#2a9154", "#c8372d", "#7a4fbf"
STYLE: Any = {
    "font.size": 9.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e8ee",
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.2,
    "svg.hashsalt": "ugv",
}


class ReportFigure(NamedTuple):
    """A picture with its title and what it shows, in a sentence."""

    title: str
    caption: str
    svg: str

    def section(self) -> str:
        """Of a page."""
        return f"<section><h2>{escape(self.title)}</h2><p>{escape(self.caption)}</p>{self.svg}</section>"


def svg(figure: Figure) -> str:
    """The figure as an element of a page."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = stream.getvalue()
    return text[text.index("<svg") :]


def thinned(t: Array, y: Array, columns: int = COLUMNS) -> tuple[Array, Array]:
    """A line with the least and the greatest value of each of `columns` stretches kept."""
    if len(t) <= 2 * columns:
        return t, y
    edges = np.linspace(0, len(t), columns + 1).astype(int)
    kept = []
    for begin, end in pairwise(edges.tolist()):
        part = y[begin:end]
        if np.isnan(part).all():
            kept.append(begin)
            continue
        kept += sorted({begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))})
    return t[kept], y[kept]


def line(axes: Axes, t: Array, y: npt.ArrayLike, label: str, color: str, width: float = 1.2) -> None:
    """A line of many points."""
    axes.plot(*thinned(t, np.asarray(y, dtype=np.float64)), label=label, color=color, linewidth=width)


def stack(rows: int, height: float = 1.75) -> tuple[Figure, list[Axes]]:
    """Axes below one another, with time in common."""
    figure = Figure(figsize=(9.6, height * rows + 0.45), layout="constrained")
    axes = [figure.add_subplot(rows, 1, 1)]
    axes += [figure.add_subplot(rows, 1, row, sharex=axes[0]) for row in range(2, rows + 1)]
    for upper in axes[:-1]:
        upper.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time (s)")
    return figure, axes


def legend(axes: Axes) -> None:
    """Names of the lines, above the axes."""
    axes.legend(loc="upper right", ncols=4, borderaxespad=0.1, bbox_to_anchor=(1.0, 1.16))
