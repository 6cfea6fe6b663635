# SPDX-License-Identifier: Apache-2.0
"""How well a path was followed: pure functions on arrays of the true pose.

The error is the planar distance of the true trunk origin to the nearest point of the path, whose arc length only grows,
averaged over time from first motion to completion (paper 000, eq 45-47). On a path with cusps the nearest point is one
of the section that is driven.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from runtime.recording.section_turns import section_starts
from runtime.tracking.paths import Polyline
from runtime.tracking.sections import SectionedPath

Array = npt.NDArray[np.float64]

FIRST_MOTION_M = 0.02
GOAL_TOLERANCE_M = 0.15
STOPPED_WITHIN_M = 0.03
STOPPED_FOR_S = 0.5
SPEED_MARGIN_M = 1.0
SEARCH_WINDOW_M = 0.5

AnyPath: TypeAlias = Polyline | SectionedPath


@dataclass(frozen=True)
class Projection:
    """Each true pose against the path.

    Attributes:
        progress: arc length of the nearest path point, never falling, m.
        distance: to it, m.
        lateral_error: signed, positive with the path to the right, m.
        heading_error: yaw minus heading of the path, rad in [-pi, pi]; on every second section, which is driven
            backwards, minus the opposite of its heading.
    """

    progress: Array
    distance: Array
    lateral_error: Array
    heading_error: Array


@dataclass(frozen=True)
class Errors:
    """Time-averaged statistics of an error."""

    mean: float
    rms: float
    max: float
    std: float


@dataclass(frozen=True)
class PathMetrics:
    """The figures of one run.

    Attributes:
        completed: stopped within 0.15 m of the goal, within the time limit.
        first_motion_s: on the clock of the samples; NaN if it never moved.
        completion_time_s: from first motion to the stop at the goal, NaN if there was none.
        path_length_m: plan length of the path.
        lateral_error_m: distance to the path.
        heading_error_rad: yaw against the path's heading.
        tracking_error_mean_m: eta, eq 46.
        tracking_error_std_m: sigma, eq 47.
        speed_mean_mps: along the surface where its profile is given; NaN on a path too short for it.
    """

    completed: bool
    first_motion_s: float
    completion_time_s: float
    path_length_m: float
    lateral_error_m: Errors
    heading_error_rad: Errors
    tracking_error_mean_m: float
    tracking_error_std_m: float
    speed_mean_mps: float

    def summary(self, commanded_mps: float) -> dict[str, Any]:
        """The part of summary.json that these figures make; None where a figure does not exist."""
        lateral, heading = self.lateral_error_m, self.heading_error_rad
        return {
            "completed": self.completed,
            "completion_time_s": or_none(self.completion_time_s),
            "path_length_m": or_none(self.path_length_m),
            "lateral_error_m": {
                "mean": or_none(lateral.mean),
                "rms": or_none(lateral.rms),
                "max": or_none(lateral.max),
                "std": or_none(lateral.std),
            },
            "heading_error_rad": {"rms": or_none(heading.rms), "max": or_none(heading.max)},
            "tracking_error_m": {
                "mean": or_none(self.tracking_error_mean_m),
                "std": or_none(self.tracking_error_std_m),
            },
            "speed_mps": {"mean": or_none(self.speed_mean_mps), "commanded": commanded_mps},
        }


def project(x: Array, y: Array, yaw: Array, path: AnyPath) -> Projection:
    """Find the nearest path point of each sample, in order."""
    count = len(x)
    progress, distance, lateral, heading = (np.empty(count) for _ in range(4))
    starts = section_starts(x, y, path.sections, SEARCH_WINDOW_M, GOAL_TOLERANCE_M, FIRST_MOTION_M)
    gone = 0.0
    for number, (section, begin, end) in enumerate(zip(path.sections, starts, [*starts[1:], count], strict=False)):
        s = 0.0
        for k in range(begin, end):
            closest = section.closest(float(x[k]), float(y[k]), s, SEARCH_WINDOW_M)
            s = closest.progress
            progress[k], distance[k], lateral[k] = gone + s, closest.distance, closest.lateral_error
            heading[k] = closest.heading + math.pi * (number % 2)
        gone += section.length
    error = np.arctan2(np.sin(yaw - heading), np.cos(yaw - heading))
    return Projection(progress, distance, lateral, error)


def first_motion(x: Array, y: Array, threshold_m: float = FIRST_MOTION_M) -> int | None:
    """Index of the last sample before the trunk has left its first place by the threshold, or None if it never has."""
    moved = np.hypot(x - x[0], y - y[0]) > threshold_m
    return max(int(np.argmax(moved)) - 1, 0) if moved.any() else None


def stop_at_goal(t: Array, x: Array, y: Array, progress: Array, path: AnyPath) -> int | None:
    """Index of the sample from which on the trunk stood within 0.15 m of the goal, at the end of the path.

    It stands where it stays within 3 cm of that place for 0.5 s (or to the end of the samples, if at least half as
    long).
    """
    goal_x, goal_y = path.goal
    near = (np.hypot(x - goal_x, y - goal_y) <= GOAL_TOLERANCE_M) & (progress >= path.length - GOAL_TOLERANCE_M)
    for k in np.flatnonzero(near).tolist():
        end = int(np.searchsorted(t, t[k] + STOPPED_FOR_S, side="right"))
        if t[end - 1] - t[k] < STOPPED_FOR_S / 2.0:
            return None
        still = np.hypot(x[k:end] - x[k], y[k:end] - y[k]) <= STOPPED_WITHIN_M
        if still.all() and near[k:end].all():
            return int(k)
    return None


def time_average(t: Array, values: Array) -> float:
    """Mean over time of a sampled signal, by trapezoids; the plain mean where no time passes."""
    span = float(t[-1] - t[0])
    if len(t) < 2 or span <= 0.0:
        return float(values.mean())
    return float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(t)) / span)


def errors(t: Array, values: Array) -> Errors:
    """Statistics of the magnitude of an error, averaged over time."""
    size = np.abs(values)
    mean, square = time_average(t, size), time_average(t, size * size)
    return Errors(mean, math.sqrt(square), float(size.max()), math.sqrt(max(square - mean * mean, 0.0)))


def tracking_error(distance: Array) -> tuple[float, float]:
    """Mean and standard deviation of the tracking error over N_e samples (paper 000, eq 45-47), m."""
    count = len(distance)
    mean = float(distance.mean())
    if count < 2:
        return mean, 0.0
    return mean, math.sqrt(float(np.sum((distance - mean) ** 2)) / (count - 1))


def surface_length(s: npt.ArrayLike, profile: npt.ArrayLike) -> Array:
    """Length along the surface at plan arc lengths `s`.

    Args:
        s: plan arc lengths, m.
        profile: plan arc length and height of the corners of the ground along the path, n x 2, m; undulation left out,
        since
            speed is commanded along the stance plane.
    """
    corners = np.asarray(profile, dtype=np.float64)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    return np.asarray(np.interp(np.asarray(s, dtype=np.float64), corners[:, 0], along))


def mean_speed(t: Array, progress: Array, length: float, profile: npt.ArrayLike | None = None) -> float:
    """Mean speed between 1 m after the start and 1 m before the end: path length gone over the time taken, m/s.

    Args:
        t: s.
        progress: plan arc length, never falling, m.
        length: plan length of the path, m.
        profile: of the ground, see `surface_length`; without it the speed is the horizontal one.

    Returns:
        NaN if the path is not longer than 2 m or its last metre was not reached.
    """
    begin, end = SPEED_MARGIN_M, length - SPEED_MARGIN_M
    if end <= begin or progress[-1] < end:
        return math.nan
    t_begin, t_end = _time_at(t, progress, begin), _time_at(t, progress, end)
    if t_end <= t_begin:
        return math.nan
    gone = end - begin
    if profile is not None:
        gone = float(np.diff(surface_length([begin, end], profile))[0])
    return gone / (t_end - t_begin)


def path_metrics(
    t: npt.ArrayLike,
    xy: npt.ArrayLike,
    yaw: npt.ArrayLike,
    path: AnyPath,
    time_limit_s: float,
    profile: npt.ArrayLike | None = None,
) -> PathMetrics:
    """All figures of a run.

    Args:
        t: sample times, rising, s; from when the path was given, or any time after standing up.
        xy: true trunk origin, n x 2, m.
        yaw: true yaw, rad.
        path: the path.
        time_limit_s: from first motion; later arrival does not count.
        profile: of the ground along the path, see `surface_length`.

    Raises:
        ValueError: if there are no samples, or the arrays differ in length.
    """
    t, xy, yaw = (np.asarray(values, dtype=np.float64) for values in (t, xy, yaw))
    if t.ndim != 1 or len(t) == 0 or xy.shape != (len(t), 2) or yaw.shape != t.shape:
        raise ValueError(f"metrics: t {t.shape}, xy {xy.shape} and yaw {yaw.shape} must be n, n x 2 and n with n > 0")
    x, y = xy[:, 0], xy[:, 1]
    start = first_motion(x, y)
    begin = 0 if start is None else start
    seen = project(x[begin:], y[begin:], yaw[begin:], path)
    stop = None if start is None else stop_at_goal(t[begin:], x[begin:], y[begin:], seen.progress, path)
    end = len(seen.progress) if stop is None else stop + 1
    t = t[begin:]
    time = math.nan if stop is None else float(t[stop] - t[0])
    mean, std = tracking_error(seen.distance[:end])
    return PathMetrics(
        completed=stop is not None and time <= time_limit_s,
        first_motion_s=math.nan if start is None else float(t[0]),
        completion_time_s=time,
        path_length_m=path.length,
        lateral_error_m=errors(t[:end], seen.distance[:end]),
        heading_error_rad=errors(t[:end], seen.heading_error[:end]),
        tracking_error_mean_m=mean,
        tracking_error_std_m=std,
        speed_mean_mps=mean_speed(t[:end], seen.progress[:end], path.length, profile),
    )


def _time_at(t: Array, progress: Array, s: float) -> float:
    """When the progress first reached `s`, interpolated."""
    k = int(np.searchsorted(progress, s, side="left"))
    if k == 0:
        return float(t[0])
    share = (s - progress[k - 1]) / (progress[k] - progress[k - 1])
    return float(t[k - 1] + share * (t[k] - t[k - 1]))


def or_none(value: float) -> float | None:
    """A figure of a summary, which has no NaN and no infinity."""
    return value if math.isfinite(value) else None
