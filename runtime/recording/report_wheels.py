# SPDX-License-Identifier: Apache-2.0
"""Figures of a vehicle's wheels: how they were steered and rolled, how they slipped, and what grip that left."""

from __future__ import annotations

import numpy as np

from runtime.recording import run_data
from runtime.recording.figure_style import BLUE, GREEN, INK, ORANGE, VIOLET, ReportFigure, legend, line, stack, svg
from runtime.recording.run_data import RunData

WHEELS = ("front left", "front right", "rear left", "rear right")
COLORS = (BLUE, ORANGE, GREEN, VIOLET)
LIMIT = 0.5
"""Slip beyond this is drawn at the edge: while a wheel hardly rolls the ratio says little."""


def stuck_wheels(data: RunData) -> list[str]:
    """A sentence for every wheel whose steering was found stuck."""
    status = data.signals.get(run_data.WHEEL_STATUS)
    if status is None:
        return []
    stuck = status.values["stuck"]
    return [
        f"The steering of the {name} wheel was stuck, first at {status.log_ns[stuck[:, wheel].argmax()] / 1e9:.2f} s."
        for wheel, name in enumerate(WHEELS)
        if stuck[:, wheel].any()
    ]


def steering_figure(data: RunData) -> ReportFigure | None:
    """Steering angles, measured and commanded."""
    return _of_wheels(data, "steering", 180.0 / np.pi, "degrees", "Steering angles", "positive to the left")


def wheel_speed_figure(data: RunData) -> ReportFigure | None:
    """Wheel speeds, measured and commanded."""
    return _of_wheels(data, "speed", 1.0, "rad/s", "Wheel speeds", "positive forward")


def slip_figure(data: RunData) -> ReportFigure | None:
    """Slip ratios: true where the log has the truth, and estimated."""
    truth, body = data.signals.get(run_data.TRUTH), data.signals.get(run_data.BODY_STATE)
    shown = [(signal, what) for signal, what in ((truth, "true"), (body, "estimated")) if signal is not None]
    shown = [(signal, what) for signal, what in shown if "slip" in (signal.values.dtype.names or ())]
    if not shown:
        return None
    figure, axes = stack(len(shown))
    for panel, (signal, what) in zip(axes, shown, strict=True):
        for wheel, (name, color) in enumerate(zip(WHEELS, COLORS, strict=True)):
            values = np.clip(signal.values["slip"][:, wheel], -LIMIT, LIMIT)
            line(panel, signal.log_ns / 1e9, values, name, color, 0.8)
        panel.set_ylabel(f"slip ratio, {what}")
        panel.set_ylim(-LIMIT, LIMIT)
        legend(panel)
    return ReportFigure(
        "Slip",
        "Rolling speed of each wheel minus its speed over the ground, by the larger of both; cut at the edges.",
        svg(figure),
    )


def grip_figure(data: RunData) -> ReportFigure | None:
    """How much of the accelerations the tracker counts on."""
    command = data.signals.get(run_data.BODY_COMMAND)
    if command is None or "grip" not in (command.values.dtype.names or ()):
        return None
    figure, (panel,) = stack(1)
    line(panel, command.log_ns / 1e9, command.values["grip"], "grip", GREEN)
    panel.set_ylabel("share")
    panel.set_ylim(0.0, 1.05)
    return ReportFigure(
        "Grip", "Share of its accelerations that the tracker counts on; it falls on sliding.", svg(figure)
    )


def _of_wheels(data: RunData, name: str, scale: float, unit: str, title: str, sense: str) -> ReportFigure | None:
    state, command = data.signals.get(run_data.WHEEL_STATE), data.signals.get(run_data.WHEEL_COMMAND)
    if state is None:
        return None
    figure, axes = stack(len(WHEELS), 1.3)
    for wheel, (panel, label, color) in enumerate(zip(axes, WHEELS, COLORS, strict=True)):
        if command is not None:
            asked = scale * command.values[name][:, wheel]
            line(panel, command.log_ns / 1e9, asked, "commanded", INK, 1.1)
        line(panel, state.log_ns / 1e9, scale * state.values[name][:, wheel], "measured", color, 0.9)
        panel.set_ylabel(f"{label}\n({unit})")
    legend(axes[0])
    return ReportFigure(title, f"Of each wheel, measured and commanded; {sense}.", svg(figure))
