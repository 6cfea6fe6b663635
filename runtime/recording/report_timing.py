# SPDX-License-Identifier: Apache-2.0
"""The report's part on time: how each loop kept it, where ticks are missing, and which wakes were late."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from runtime.recording.beginning import beginning, clock_changes
from runtime.recording.loop_timing import LoopTimes, Percentiles, imu_age
from runtime.recording.run_data import RunData

_SHOWN = 12
_SHARES = ("p50", "p99", "p99.9", "max")
_COUNTS = ("periods skipped", "late", "missing", "late wakes")


def timing_section(data: RunData) -> str:
    """What the log says of time, as a section; empty if there is nothing to say."""
    times = [one for one in data.loop_times if one.ticks]
    if not times:
        return ""
    rows = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in _cells(one)) + "</tr>" for one in times)
    shares = "".join(f"<th>{name}</th>" for name in _SHARES)
    counts = "".join(f'<th rowspan="2">{name}</th>' for name in _COUNTS)
    head = (
        '<tr><th rowspan="2">loop</th><th rowspan="2">rate</th><th rowspan="2">ticks</th>'
        f'<th colspan="4">wake latency (us)</th><th colspan="4">compute time (us)</th>{counts}</tr>'
        f"<tr>{shares}{shares}</tr>"
    )
    return (
        "<section><h2>Time</h2><p>A tick that began more than a period after its release is a late wake. Periods that "
        "an overrun skipped were never stepped; missing ticks were, but are not in the log.</p>"
        f'<table class="times"><thead>{head}</thead><tbody>{rows}</tbody></table>'
        + _list("Said by the log", _said(data))
        + _list("Gaps", [str(gap) for one in times for gap in one.gaps])
        + _list("Latest wakes", _late_wakes(times))
        + "</section>"
    )


def timing_cards(data: RunData) -> Iterator[tuple[str, str]]:
    """The main figures of a run on the wall clock."""
    for one in data.loop_times:
        if one.wake is not None:
            name = one.loop.name
            yield f"{name} wake latency, p99", f"{one.wake.p99 / 1e3:,.0f} us"
            yield f"{name} periods skipped", f"{100.0 * one.skipped / (one.ticks + one.skipped):.3g} %"
            yield f"{name} ticks missing", str(one.missing)


def timing_warnings(data: RunData) -> list[str]:
    """What a reader of the figures should know of the log's time, in sentences."""
    said = []
    for one in data.loop_times:
        name = one.loop.name
        if one.missing:
            where = "place" if len(one.gaps) == 1 else "places"
            said.append(f"Up to {one.missing} ticks of loop {name} are missing, in {len(one.gaps)} {where}.")
        if one.late or one.skipped:
            said.append(
                f"Loop {name}: results of {one.late} ticks left after the budget, {one.skipped} periods were skipped."
            )
        elif one.over_budget:
            said.append(
                f"Loop {name}: {one.over_budget} of {one.ticks} ticks took more wall time than the budget of "
                f"{one.loop.budget_ns / 1e6:g} ms, which slows a simulation and changes nothing in it; on the robot "
                f"their results would be late."
            )
    return said


def _cells(one: LoopTimes) -> tuple[str, ...]:
    counts = (one.skipped, one.late, one.missing, len(one.late_wakes))
    return (
        escape(one.loop.name),
        f"{1e9 / one.loop.period_ns:g} Hz",
        str(one.ticks),
        *_row(one.wake),
        *_row(one.compute),
        *(f"<b>{count}</b>" if count else "0" for count in counts),
    )


def _row(times: Percentiles | None) -> list[str]:
    return ["-"] * len(_SHARES) if times is None else [f"{value / 1e3:,.0f}" for value in times]


def _said(data: RunData) -> list[str]:
    said = [f"The log {sentence}." for sentence in [beginning(data.log)] if sentence]
    said += [f"Of the clocks: {sentence}." for sentence in clock_changes(data.log)]
    age = imu_age(data.log)
    if age is not None:
        shares = ", ".join(f"{name} {value / 1e6:.3g}" for name, value in zip(_SHARES, age, strict=True))
        said.append(f"Age of the inertial samples that the estimator used: {shares} ms.")
    return said


def _late_wakes(times: Sequence[LoopTimes]) -> list[str]:
    found = sorted((wake for one in times for wake in one.late_wakes), key=lambda wake: -wake.late_ns)
    return [
        f"{wake.loop}, tick {wake.tick}: {wake.late_ns / 1e6:,.1f} ms late at {wake.begin_ns / 1e9:.3f} s"
        for wake in found
    ]


def _list(title: str, sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    shown = [*sentences[:_SHOWN]]
    if len(sentences) > _SHOWN:
        shown.append(f"... and {len(sentences) - _SHOWN} more")
    return f"<h3>{escape(title)}</h3><ul>{''.join(f'<li>{escape(sentence)}</li>' for sentence in shown)}</ul>"
