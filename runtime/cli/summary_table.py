# SPDX-License-Identifier: Apache-2.0
"""The summary of a run, for people; `summary.json` has the same figures under their keys."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from runtime.cli.console import print_table
from runtime.executors.resources import FILES_HELD

_CENTIMETRES, _DEGREES = 100.0, 180.0 / math.pi
_MEGABYTE = 1e6
LOOPS = {"wbc": "WBC tick", "mpc": "MPC step", "drive": "drive tick"}


def print_summary(summary: Mapping[str, Any]) -> None:
    """Print a run's summary as a table; figures that the run does not have are left out."""
    parts = ("robot", "scenario", "controller", "estimator")
    title = " · ".join([*(str(summary[key]) for key in parts if key in summary), f"seed {summary.get('seed', 0)}"])
    print_table(title, ("figure", "value"), list(summary_rows(summary)))


def summary_rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Label and value of each line."""
    yield "outcome", outcome(summary)
    yield from (("flaw", flaw) for flaw in summary.get("flaws", ()))
    if "laps" in summary:
        yield "laps", str(summary["laps"])
    yield from (("power lost", _laid(fault)) for fault in summary.get("faults", ()))
    yield from (("paused", _laid(fault)) for fault in summary.get("pauses", ()))
    if summary.get("completion_time_s") is not None:
        yield "time to the goal", f"{summary['completion_time_s']:.2f} s"
    if summary.get("path_length_m") is not None:
        yield "path length", f"{summary['path_length_m']:.2f} m"
    speed = summary.get("speed_mps", {})
    if speed.get("mean") is not None:
        yield "mean speed", f"{speed['mean']:.3f} m/s, commanded {speed['commanded']:.3f} m/s"
    for key, label, scale, unit in (
        ("lateral_error_m", "lateral error", _CENTIMETRES, "cm"),
        ("heading_error_rad", "heading error", _DEGREES, "degrees"),
        ("tracking_error_m", "tracking error (eq 46, 47)", _CENTIMETRES, "cm"),
    ):
        figures = {name: value for name, value in summary.get(key, {}).items() if value is not None}
        if figures:
            yield label, _joined(figures, scale, unit)
    if "push" in summary:
        yield "push", _push(summary["push"])
    if "settling" in summary:
        yield "onto the path", _settling(summary["settling"])
    if "turn" in summary:
        yield "turn", _turn(summary["turn"])
    if "patch" in summary:
        yield "slippery patch", _patch(summary["patch"])
    for name, label in LOOPS.items():
        if f"{name}_ms" in summary:
            yield label, _joined(summary[f"{name}_ms"], 1.0, "ms")
    if summary.get("imu_age_ms"):
        yield "age of inertial samples", _joined(summary["imu_age_ms"], 1.0, "ms")
    missed = summary.get("missed_deadlines", {})
    if missed:
        yield "longer than their period", ", ".join(f"{count} of {name}" for name, count in missed.items())
    for process, held in summary.get("resources", {}).items():
        if held["early"] and held["late"]:
            yield f"held by {process}", _held(held["early"], held["late"])
    if {"sim_time_s", "wall_time_s", "realtime_factor"} <= summary.keys():
        factor = f"{summary['realtime_factor']:.2f} times real time"
        yield "simulated", f"{summary['sim_time_s']:.2f} s in {summary['wall_time_s']:.2f} s: {factor}"


def outcome(summary: Mapping[str, Any]) -> str:
    """Whether it got there, and what went wrong."""
    words = ["completed"]
    if not summary.get("completed"):
        late = summary.get("completion_time_s") is not None
        words = ["NOT completed: arrived too late" if late else "NOT completed"]
    if summary.get("fell"):
        words.append("FELL")
    if summary.get("fault"):
        words.append(", ".join((f"FAULT {summary['fault']}", *summary.get("broken", ()))))
    return ", ".join(words)


def _laid(fault: Mapping[str, Any]) -> str:
    """A fault, and the stall that it is laid to."""
    bound, stall = fault["bound"], fault["stall"]
    if bound is None:
        return f"{fault['fault']}, which no stall makes"
    found = f"after a stall of {stall['loop']} of {stall['ms']:.3g} ms" if stall else "no stall"
    return f"{fault['fault']}, {found} beyond {bound['ms']:.3g} ms{_slow(fault['slow'])}"


def _slow(slow: Mapping[str, Any] | None) -> str:
    """What ticks took and what their tasks need, if that is what tells the stall."""
    if slow is None:
        return ""
    took, need = (f"for {slow[key]:.3g} ms" for key in ("took_ms", "need_ms"))
    return f" ({slow['ticks']} ticks computed {took}; stepped again, {need})"


def _held(early: Mapping[str, int], late: Mapping[str, int]) -> str:
    memory = (held["resident_bytes"] / _MEGABYTE for held in (early, late))
    words = ["{:.1f} then {:.1f} MB".format(*memory)]
    words += [f"{early[key]} then {late[key]} {what}" for key, what in FILES_HELD.items()]
    return ", ".join(words)


def _joined(figures: Mapping[str, float], scale: float, unit: str) -> str:
    names = {"rms": "RMS", "p99": "p99"}
    shown = (f"{names.get(name, name)} {_three_digits(value * scale)}" for name, value in figures.items())
    return f"{', '.join(shown)} {unit}"


def _three_digits(value: float) -> str:
    return f"{value:.2f}" if abs(value) < 100.0 else f"{value:.0f}"


def _settling(settling: Mapping[str, Any]) -> str:
    words = []
    if settling["time_s"] is not None:
        words.append(f"settled in {settling['time_s']:.1f} s")
    for key, what in (
        ("overshoot_m", "overshoot"),
        ("mean_25_s_m", "mean over 25 s"),
        ("mean_approach_m", "over 12 s"),
        ("mean_after_m", "after them"),
    ):
        if settling[key] is not None:
            words.append(f"{what} {settling[key] * _CENTIMETRES:.1f} cm")
    return ", ".join(words) or "never moved"


def _turn(turn: Mapping[str, Any]) -> str:
    turned, error, moved = turn["turned_rad"], turn["error_rad"], turn["displacement_m"]
    degrees = f"{turned * _DEGREES:.1f} degrees, {error * _DEGREES:+.1f} from what was asked"
    return f"{degrees}, displaced by up to {moved * _CENTIMETRES:.1f} cm"


def _patch(patch: Mapping[str, Any]) -> str:
    words = [f"side slip up to {patch['side_slip_max_rad'] * _DEGREES:.1f} degrees"]
    for key, what in (("speed_entry_mps", "entered at"), ("speed_least_mps", "slowest"), ("speed_mean_mps", "mean")):
        if patch[key] is not None:
            words.append(f"{what} {patch[key]:.2f} m/s")
    return ", ".join(words)


def _push(push: Mapping[str, Any]) -> str:
    words = ["withstood" if push["passed"] else "NOT withstood"]
    words.append("back at speed in 3 s" if push["back_at_speed"] else "NOT back at speed in 3 s")
    if push.get("displacement_m") is not None:
        words.append(f"displaced by up to {push['displacement_m'] * _CENTIMETRES:.1f} cm")
    if push.get("distance_later_m") is not None:
        words.append(f"{push['distance_later_m'] * _CENTIMETRES:.1f} cm off 5 s later")
    return ", ".join(words)
