# SPDX-License-Identifier: Apache-2.0
"""The paper's figures of a run, as SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from runtime.recording import run_data
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
    legend,
    line,
    stack,
    svg,
)
from runtime.recording.report_wheels import grip_figure, slip_figure, steering_figure, wheel_speed_figure
from runtime.recording.run_data import RunData, yaw_of
from runtime.recording.wake_figure import wake_figure
from runtime.signals import Mode

_CLOSE_UP_S = 1.5


def figures(data: RunData) -> list[ReportFigure]:
    """Every figure that the run has data for."""
    makers: Sequence[Callable[[RunData], ReportFigure | None]] = (
        _map,
        _path_errors,
        _velocities,
        _torques,
        steering_figure,
        wheel_speed_figure,
        slip_figure,
        grip_figure,
        _look_ahead,
        _estimate,
        _loop_times,
        wake_figure,
        _safety,
    )
    with mpl.rc_context(STYLE):
        return [made for made in (make(data) for make in makers) if made is not None]


def _map(data: RunData) -> ReportFigure | None:
    if data.pose_topic is None:
        return None
    position = data.signals[data.pose_topic].values["position"]
    shown = np.vstack((position[:, :2], data.path_points))
    low, high = shown.min(axis=0) - 0.8, shown.max(axis=0) + 0.8
    span = high - low
    figure = Figure(figsize=(9.6, float(np.clip(8.2 * span[1] / span[0] + 0.8, 2.6, 7.6))), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(False)
    if data.terrain is not None:
        rows, columns = data.terrain.heights.shape
        x0, y0, d = data.terrain.x0, data.terrain.y0, data.terrain.spacing
        i0, i1 = np.clip([int((low[1] - y0) // d), int((high[1] - y0) // d) + 2], 0, rows)
        j0, j1 = np.clip([int((low[0] - x0) // d), int((high[0] - x0) // d) + 2], 0, columns)
        if i1 - i0 > 1 and j1 - j0 > 1:
            extent = (x0 + (j0 - 0.5) * d, x0 + (j1 - 0.5) * d, y0 + (i0 - 0.5) * d, y0 + (i1 - 0.5) * d)
            heights = data.terrain.heights[i0:i1, j0:j1]
            scale, unit = (100.0, "cm") if np.ptp(heights) < 0.5 else (1.0, "m")
            image = axes.imshow(
                heights * scale, extent=extent, origin="lower", cmap="YlGnBu_r", alpha=0.45, interpolation="nearest"
            )
            if np.ptp(heights) > 0.0:
                figure.colorbar(image, ax=axes, label=f"terrain height ({unit})", shrink=0.8, pad=0.015)
    if len(data.path_points):
        axes.plot(*data.path_points.T, color=INK, linewidth=2.2, linestyle=(0, (4, 2)), label="desired path")
    chosen = run_data.every(data.signals[data.pose_topic].log_ns, 20_000_000)
    axes.plot(*position[chosen, :2].T, color=RED, linewidth=1.5, label="actual path (robot)")
    axes.plot(*position[0, :2], "o", color=GREEN, markersize=7, label="start")
    axes.plot(*position[-1, :2], "s", color=RED, markersize=6, label="end")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.legend(loc="lower left", ncols=4, bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    whose = "true" if data.pose_topic == run_data.TRUTH else "estimated (the log has no true)"
    ground = " over the terrain's height" if data.terrain is not None else ""
    return ReportFigure("Path", f"Desired path and {whose} path of the robot{ground}.", svg(figure))


def _path_errors(data: RunData) -> ReportFigure | None:
    seen = data.against_path
    if seen is None:
        return None
    figure, axes = stack(4)
    rows = (
        ("lateral error (cm)", 100 * seen.projection.lateral_error, VIOLET),
        ("x error (cm)", 100 * seen.x_error, BLUE),
        ("y error (cm)", 100 * seen.y_error, ORANGE),
        ("yaw error (deg)", np.degrees(seen.projection.heading_error), GREEN),
    )
    for panel, (label, values, color) in zip(axes, rows, strict=True):
        panel.axhline(0.0, color=FAINT, linewidth=0.8)
        line(panel, seen.t, values, label, color)
        panel.set_ylabel(label)
    return ReportFigure(
        "Tracking errors",
        "Robot against the nearest path point, whose arc length only grows until the path is taken up anew; yaw "
        "against the path's heading there.",
        svg(figure),
    )


def _velocities(data: RunData) -> ReportFigure | None:
    if data.pose_topic is None:
        return None
    pose = data.signals[data.pose_topic]
    t, rows = pose.log_ns / 1e9, pose.values
    yaw, v = yaw_of(rows["orientation"]), rows["linear_velocity"]
    forward = np.cos(yaw) * v[:, 0] + np.sin(yaw) * v[:, 1]
    lateral = -np.sin(yaw) * v[:, 0] + np.cos(yaw) * v[:, 1]
    figure, axes = stack(3)
    line(axes[0], t, forward, "forward", BLUE, 0.9)
    line(axes[1], t, lateral, "lateral", ORANGE, 0.9)
    line(axes[2], t, rows["angular_velocity"][:, 2], "yaw rate", GREEN, 0.9)
    command = data.signals.get(run_data.BODY_COMMAND)
    if command is not None:
        asked = command.values
        for panel, values in zip(axes, (*asked["velocity"].T, asked["yaw_rate"]), strict=True):
            panel.step(command.log_ns / 1e9, values, where="post", color=INK, linewidth=1.1, label="commanded")
    for panel, label in zip(axes, ("forward (m/s)", "lateral (m/s)", "yaw rate (rad/s)"), strict=True):
        panel.set_ylabel(label)
        legend(panel)
    return ReportFigure(
        "Velocities",
        "Linear velocity along and across the robot's heading, and angular velocity about z.",
        svg(figure),
    )


def _torques(data: RunData) -> ReportFigure | None:
    joints = data.signals.get(run_data.JOINT_STATE)
    if joints is None:
        return None
    effort, t = joints.values["effort"], joints.log_ns / 1e9
    count = min(3, effort.shape[1])
    figure = Figure(figsize=(9.6, 1.75 * count + 0.45), layout="constrained")
    grid = figure.add_gridspec(count, 2, width_ratios=(3, 2))
    middle = float(t[len(t) // 2])
    near = np.abs(t - middle) <= _CLOSE_UP_S / 2
    command = data.signals.get(run_data.JOINT_COMMAND)
    for joint, color in enumerate((BLUE, ORANGE, GREEN)[:count]):
        whole = figure.add_subplot(grid[joint, 0])
        close = figure.add_subplot(grid[joint, 1], sharey=whole)
        line(whole, t, effort[:, joint], "measured", color, 0.6)
        close.plot(t[near], effort[near, joint], color=color, label="measured")
        if command is not None:
            shown = np.abs(command.log_ns / 1e9 - middle) <= _CLOSE_UP_S / 2
            feed = command.values["effort"][shown, joint]
            close.plot(command.log_ns[shown] / 1e9, feed, color=INK, linewidth=0.8, label="feed-forward")
        name = data.joint_names[joint] if joint < len(data.joint_names) else f"joint {joint + 1}"
        whole.set_ylabel(f"{name}\n(N·m)")
        if joint == 0:
            legend(close)
        if joint == count - 1:
            whole.set_xlabel("time (s)")
            close.set_xlabel("time (s)")
    return ReportFigure(
        "Joint torques",
        f"Torques of the joints of the first leg: the whole run, and {_CLOSE_UP_S:g} s in the middle of it.",
        svg(figure),
    )


def _look_ahead(data: RunData) -> ReportFigure | None:
    command = data.signals.get(run_data.BODY_COMMAND)
    if command is None:
        return None
    followed = command.values["look_ahead"] > 0.0
    if not followed.any():
        return None
    t, rows = command.log_ns[followed] / 1e9, command.values[followed]
    panels = [("look-ahead (m)", rows["look_ahead"], GREEN)]
    said = "Distance to the point that is pursued."
    if "k_v" in (rows.dtype.names or ()):
        panels = [("$k_v$", rows["k_v"], BLUE), ("$k_w$", rows["k_w"], ORANGE), *panels]
        said = "Coefficients k_v and k_w of the fuzzy look-ahead (eq 17) and the distance they make."
    figure, axes = stack(len(panels))
    for panel, (label, values, color) in zip(axes, panels, strict=True):
        line(panel, t, values, label, color)
        panel.set_ylabel(label)
    return ReportFigure("Look-ahead", said, svg(figure))


def _estimate(data: RunData) -> ReportFigure | None:
    truth, body = data.signals.get(run_data.TRUTH), data.signals.get(run_data.BODY_STATE)
    if truth is None or body is None:
        return None
    started = body.values["stamp_ns"] > 0
    if not started.any():
        return None
    log_ns, estimate = body.log_ns[started], body.values[started]
    t = log_ns / 1e9
    at = np.clip(np.searchsorted(truth.log_ns, log_ns, side="right") - 1, 0, None)
    gap = 100 * (estimate["position"] - truth.values["position"][at])
    turn = yaw_of(estimate["orientation"]) - yaw_of(truth.values["orientation"][at])
    figure, axes = stack(2)
    for axis, color in enumerate((BLUE, ORANGE, GREEN)):
        line(axes[0], t, gap[:, axis], "xyz"[axis], color, 0.9)
    axes[0].set_ylabel("position (cm)")
    legend(axes[0])
    line(axes[1], t, np.degrees(np.angle(np.exp(1j * turn))), "yaw", VIOLET, 0.9)
    axes[1].set_ylabel("yaw (deg)")
    return ReportFigure("Estimate", "Estimated minus true pose of the robot.", svg(figure))


def _loop_times(data: RunData) -> ReportFigure | None:
    loops = [loop for loop in data.loops if loop.name in data.ticks]
    if not loops:
        return None
    figure = Figure(figsize=(9.6, 2.35 * len(loops) + 0.2), layout="constrained")
    grid = figure.add_gridspec(len(loops), 2, width_ratios=(3, 2))
    for row, (loop, color) in enumerate(zip(loops, (BLUE, ORANGE, GREEN, VIOLET) * len(loops), strict=False)):
        ticks = data.ticks[loop.name]
        cost, t = ticks.values["compute_ns"] / 1e6, ticks.log_ns / 1e9
        shares = (50.0, 99.0, 99.9)
        values = np.percentile(cost, shares)
        top = max(1.3 * float(values[-1]), 1.2 * loop.budget_ns / 1e6)
        late, histogram = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        line(late, t, cost, loop.name, color, 0.8)
        late.axhline(loop.budget_ns / 1e6, color=RED, linewidth=1.0, linestyle="--", label="budget")
        late.set(ylabel="compute time (ms)", xlabel="time (s)" if row == len(loops) - 1 else "", ylim=(0.0, top))
        late.set_title(f"{loop.name}, {1e9 / loop.period_ns:g} Hz, max {float(cost.max()):.3g} ms")
        legend(late)
        histogram.hist(np.minimum(cost, top), bins=60, range=(0.0, top), color=color, alpha=0.75, log=True)
        histogram.set(xlabel="compute time (ms)" if row == len(loops) - 1 else "", ylabel="ticks")
        for value in values:
            histogram.axvline(float(value), color=INK, linewidth=0.9, linestyle="--")
        histogram.set_title(
            "   ".join(f"p{share:g} {value:.3f}" for share, value in zip(shares, values, strict=True)) + " ms"
        )
    return ReportFigure(
        "Loop times",
        "Wall time that the tasks of each loop took, tick by tick, and how it is distributed; the axes end above the "
        "99.9th percentile, and what is longer counts at their end.",
        svg(figure),
    )


def _safety(data: RunData) -> ReportFigure | None:
    safety = data.signals.get(run_data.SAFETY)
    if safety is None:
        return None
    t, mode = safety.log_ns / 1e9, safety.values["mode"]
    figure = Figure(figsize=(9.6, 1.25), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(False)
    colors = {
        Mode.OFF: "#b8c2cc",
        Mode.STANDBY: "#8fb4e3",
        Mode.STANDING: BLUE,
        Mode.ACTIVE: GREEN,
        Mode.DAMPED: RED,
    }
    edges = [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist(), len(mode) - 1]
    named = set()
    for begin, end in pairwise(edges):
        value = int(mode[begin])
        name = Mode(value).name if value in set(Mode) else f"mode {value}"
        color = colors.get(Mode(value), FAINT) if value in set(Mode) else FAINT
        axes.axvspan(t[begin], t[end], color=color, linewidth=0, label=name if name not in named else None)
        named.add(name)
    axes.set(yticks=[], xlabel="time (s)", xlim=(t[0], max(t[-1], t[0] + 1e-3)))
    axes.spines["left"].set_visible(False)
    axes.legend(loc="lower left", ncols=5, bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    return ReportFigure("Safety", "State of the safety filter.", svg(figure))
