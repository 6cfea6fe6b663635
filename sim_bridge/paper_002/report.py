# SPDX-License-Identifier: Apache-2.0
"""The report of the experiments: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template

from runtime.errors import OutputError
from runtime.recording.figure_style import ReportFigure
from runtime.recording.report import NAME, style
from sim_bridge.paper_002.tables import Table

TEXTS = ("plant", "method")
"""Columns that hold no figures."""
TITLE = "Paper 002: pure pursuit with longitudinal distance constraint"
FOOTER = (
    "Kinematic plants: wheelbase 1.17 m, track 0.74 m, steering at 20 degrees a second on the centre angle (the ideal "
    "one at once), commands every 0.12 s, 0.6 m/s, rolling at the start; errors are distances of the true centre to "
    "the path. Where the pose is late, the wheels' encoders are not: methods that make nothing of a delay take the late"
    " pose for the present one, the others carry it on by its stamp and the wheels, as the vehicle's filter does. In "
    "MuJoCo all drive by that filter. The paper's own figures are of its vehicle."
)


def write_report(
    directory: Path,
    facts: Sequence[str],
    found: Sequence[str],
    tables: Sequence[Table],
    figures: Sequence[ReportFigure],
) -> Path:
    """Write `report.html`; returns its path.

    Args:
        directory: where to.
        facts: for the head of the page.
        found: what came out, in sentences.
        tables: the figures.
        figures: the pictures.

    Raises:
        OutputError: if the file cannot be written.
    """
    template = resources.files("sim_bridge.paper_002").joinpath("report_template.html").read_text(encoding="utf-8")
    text = Template(template).substitute(
        style=style(),
        title=escape(TITLE),
        facts="".join(f"<li>{escape(fact)}</li>" for fact in facts),
        findings=_findings(found),
        tables="\n".join(_table(table) for table in tables),
        figures="\n".join(made.section() for made in figures),
        footer=escape(FOOTER),
    )
    path = directory / NAME
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _findings(found: Sequence[str]) -> str:
    if not found:
        return ""
    entries = "".join(f"<li>{escape(sentence)}</li>" for sentence in found)
    return f'<section class="warnings"><h2>What came out</h2><ul>{entries}</ul></section>'


def _table(table: Table) -> str:
    header = "".join(_cell(name, name, "th") for name in table.header)
    rows = "".join("<tr>" + "".join(map(_cell, row, table.header)) + "</tr>" for row in table.rows)
    return (
        f'<section><h2>{escape(table.title)}</h2><div class="wide"><table><thead><tr>{header}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div></section>"
    )


def _cell(text: str, column: str, element: str = "td") -> str:
    kinds = {"kept": "kept", "aim met": "aim", "MISSED": "missed", "beside: above": "above"}
    kind = "text" if column in TEXTS else kinds.get(text, "")
    return f"<{element}" + (f' class="{kind}"' if kind else "") + f">{escape(text)}</{element}>"
