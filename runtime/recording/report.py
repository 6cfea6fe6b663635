# SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from runtime.recording import run_data, setup
from runtime.recording.counters import counters
from runtime.recording.errors import LogError, RecordingError
from runtime.recording.report_safety import safety_warnings
from runtime.recording.report_timing import timing_cards, timing_section, timing_warnings
from runtime.recording.report_wheels import stuck_wheels
from runtime.recording.run_data import RunData, load_run

NAME = "report.html"


def write_report(run: Path) -> Path:
    """Write `report.html` beside the log; returns its path.

    Args:
        run: a run directory, or the .mcap file in it.

    Raises:
        LogError: if there is no readable log.
        RecordingError: if the file cannot be written.
    """
    data = load_run(run)
    path = data.log.path.parent / NAME
    text = report(data)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {(error.strerror or str(error)).lower()}") from error
    return path


def report(data: RunData) -> str:
    """The page."""
    from runtime.recording.report_figures import figures

    template = resources.files("runtime.recording").joinpath("report_template.html").read_text(encoding="utf-8")
    sections = "\n".join(made.section() for made in figures(data))
    return Template(template).substitute(
        style=style(),
        title=escape(_title(data)),
        facts="".join(f'<li class="{kind}">{escape(text)}</li>' for text, kind in _facts(data)),
        cards="".join(
            f'<div class="figure-card"><b>{escape(value)}</b><span>{escape(what)}</span></div>'
            for what, value in _cards(data)
        ),
        warnings=_warning_section(warnings(data)),
        timing=timing_section(data),
        counters=_counter_section(counters(data)),
        figures=sections,
        summary=_tables(list(_flat(data.summary))),
        log=_tables(_log_rows(data)),
        config=escape(data.log.attachments.get(setup.CONFIG, b"not in the log").decode(errors="replace")),
        footer=escape(f"Made from {data.log.path.name}. Errors are against the true pose where the log has it."),
    )


def style() -> str:
    """The style sheet that all reports have."""
    return resources.files("runtime.recording").joinpath("report_style.css").read_text(encoding="utf-8")


def warnings(data: RunData) -> list[str]:
    """What a reader of the figures should know, in sentences."""
    said = []
    if data.log.truncated:
        said.append(f"The log was cut off; it is whole up to {(data.log.end_ns - data.log.origin_ns) / 1e9:.2f} s.")
    said += [f"The log is damaged: {phrase}." for phrase in data.log.damage]
    if not data.summary and setup.BEGINNING not in data.log.metadata:
        said.append("There is no summary.json beside the log.")
    if data.pose_topic != run_data.TRUTH:
        said.append("The log has no true pose, so errors are those of the estimate.")
    expected = {**_EXPECTED, **(_OF_WHEELS if run_data.WHEEL_STATE in data.log.channels else _OF_JOINTS)}
    said += [f"The log has no {what}." for topic, what in expected.items() if topic not in data.signals]
    if data.path is None and run_data.PATH in data.signals:
        said.append("No path of at least two points was given, so there are no tracking errors.")
    said += safety_warnings(data) + stuck_wheels(data) + timing_warnings(data)
    return said


_EXPECTED = {
    run_data.BODY_COMMAND: "body command (/ugv/body_command)",
    run_data.PATH: "path (/ugv/path)",
    run_data.SAFETY: "safety status (/ugv/safety)",
}
_OF_JOINTS = {run_data.JOINT_STATE: "joint state (/ugv/joint_state)"}
_OF_WHEELS = {run_data.WHEEL_STATE: "wheel state (/ugv/wheel_state)"}


def _title(data: RunData) -> str:
    robot = str(data.summary.get("robot") or data.log.robot or "robot")
    scenario = data.summary.get("scenario")
    return f"{robot} · {scenario}" if scenario else f"{robot} · {data.log.path.parent.resolve().name}"


def _facts(data: RunData) -> Iterator[tuple[str, str]]:
    """Short facts for the head of the page, with the class they are shown in."""
    summary = data.summary
    if "completed" in summary:
        yield ("completed", "good") if summary["completed"] else ("not completed", "bad")
    if summary.get("fell"):
        yield "fell", "bad"
    if summary.get("fault"):
        yield f"fault: {summary['fault']}", "bad"
    for key in ("controller", "estimator"):
        if summary.get(key):
            yield f"{key} {summary[key]}", ""
    with suppress(LogError):
        yield f"seed {data.log.seed}", ""
    yield f"{(data.log.end_ns - data.log.start_ns) / 1e9:.2f} s recorded", ""


_CARDS: tuple[tuple[str, tuple[str, ...], float, str], ...] = (
    ("lateral error, RMS", ("lateral_error_m", "rms"), 100.0, "{:.2f} cm"),
    ("tracking error, mean", ("tracking_error_m", "mean"), 100.0, "{:.2f} cm"),
    ("heading error, RMS", ("heading_error_rad", "rms"), 180.0 / np.pi, "{:.2f}°"),
    ("mean speed", ("speed_mps", "mean"), 1.0, "{:.3f} m/s"),
    ("completion time", ("completion_time_s",), 1.0, "{:.2f} s"),
    ("MPC, median", ("mpc_ms", "median"), 1.0, "{:.2f} ms"),
    ("WBC tick, median", ("wbc_ms", "median"), 1.0, "{:.2f} ms"),
    ("drive tick, median", ("drive_ms", "median"), 1.0, "{:.2f} ms"),
    ("real-time factor", ("realtime_factor",), 1.0, "{:.2f}"),
)


def _cards(data: RunData) -> Iterator[tuple[str, str]]:
    """The main figures."""
    for what, keys, scale, form in _CARDS:
        value: Any = data.summary
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        if isinstance(value, (int, float)):
            yield what, form.format(value * scale)
    yield from timing_cards(data)


def _flat(entries: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        elif isinstance(value, float):
            yield prefix + key, f"{value:.5g}"
        else:
            yield prefix + key, "-" if value is None else str(value)


def _log_rows(data: RunData) -> list[tuple[str, str]]:
    log = data.log
    rows = [
        ("file", log.path.name),
        ("size", f"{log.path.stat().st_size / 1e6:.1f} MB"),
        ("topics", str(len(log.channels))),
    ]
    if setup.REVISION in log.attachments:
        rows.append(("revision", log.text(setup.REVISION).strip()))
    for name in (setup.FINGERPRINT, setup.VERSIONS):
        if name in log.attachments:
            content = log.json(name)
            if isinstance(content, dict):
                rows += [(str(k), str(v)) for k, v in content.items() if (str(k), str(v)) not in rows]
    return rows


def _tables(rows: list[tuple[str, str]]) -> str:
    """Rows as two tables side by side."""
    half = (len(rows) + 1) // 2
    return "".join(
        "<table>" + "".join(f"<tr><td>{escape(k)}</td><td>{escape(v)}</td></tr>" for k, v in part) + "</table>"
        for part in (rows[:half], rows[half:])
        if part
    )


def _counter_section(counted: list[tuple[int, str]]) -> str:
    if not counted:
        return ""
    rows = "".join(
        f'<tr class="{"some" if total else "none"}"><td>{total or "no"}</td><td>{escape(sentence)}</td></tr>'
        for total, sentence in counted
    )
    return (
        "<section><h2>Counted</h2><p>What the robot bridged, limited or rejected on the way, since the start.</p>"
        f'<table class="counted">{rows}</table></section>'
    )


def _warning_section(said: list[str]) -> str:
    if not said:
        return ""
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in said)
    return f'<section class="warnings"><h2>Worth knowing</h2><ul>{items}</ul></section>'
