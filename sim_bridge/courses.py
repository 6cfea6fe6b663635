# SPDX-License-Identifier: Apache-2.0
"""The scenarios of a quadruped, by name."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from runtime.errors import unknown
from runtime.tracking import paths
from sim_bridge import terrain
from sim_bridge.scenario import Points, Push, Scenario, UnknownScenarioError
from sim_bridge.terrain import HeightField

STARTING_AND_STOPPING_S = 4.0
"""Given to a path of one's own, which may be too short to make up for it."""


def _walk(
    name: str,
    waypoints: paths.Waypoints,
    ground: Callable[[int], HeightField],
    speed_mps: float,
    *,
    closed: bool = False,
    profile: Points = (),
    start_yaw_rad: float | None = None,
    time_beside_s: float = 0.0,
    push: Push | None = None,
) -> Scenario:
    path = paths.Polyline(waypoints, closed)
    profile = profile or ((0.0, 0.0), (path.length, 0.0))
    surface = sum(math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(profile))
    yaw = start_yaw_rad
    if yaw is None:
        # The circle's first chord lies half a step off its tangent.
        yaw = 0.0 if closed else path.heading(0.0)
    x, y = waypoints[0].tolist()
    return Scenario(
        name=name,
        waypoints=tuple((x, y) for x, y in waypoints.tolist()),
        closed=closed,
        speed_mps=speed_mps,
        start_pose=(x, y, yaw),
        terrain=ground,
        profile=profile,
        nominal_time_s=surface / speed_mps + time_beside_s,
        time_beside_s=time_beside_s,
        push=push,
    )


def _level(waypoints: paths.Waypoints) -> Callable[[int], HeightField]:
    extent = terrain.extent_of(waypoints)
    return lambda seed: terrain.flat(extent)


def _rough(waypoints: paths.Waypoints, amplitude_m: float) -> Callable[[int], HeightField]:
    return partial(terrain.undulation, amplitude_m, terrain.extent_of(waypoints))


def _straight(name: str, length_m: float) -> Scenario:
    path = paths.straight(length_m)
    return _walk(name, path, _level(path), 0.6)


def _push() -> Scenario:
    path = paths.straight(10.0)
    # Room to be pushed off the path.
    extent = terrain.extent_of(path, 3.0)
    return _walk("push", path, lambda seed: terrain.flat(extent), 0.6, push=Push())


def _line(name: str, amplitude_m: float) -> Scenario:
    path = paths.line()
    return _walk(name, path, _rough(path, amplitude_m), 0.6)


def _circle() -> Scenario:
    path = paths.circle(5.0)
    return _walk("circle-6cm", path, _rough(path, 0.06), 0.6, closed=True)


def _s_curve() -> Scenario:
    path, course = paths.s_curve(), paths.SCurve()
    extent = terrain.extent_of(path)
    length = paths.Polyline(path).length
    climb_end = course.level_in_m + course.climb_m
    brow = length - course.level_out_m - course.descent_m
    top = course.plateau_m
    climb = ((0.0, 0.0), (course.level_in_m, 0.0), (climb_end, top))
    profile = (*climb, (brow, top), (length - course.level_out_m, 0.0), (length, 0.0))
    return _walk("s-curve", path, lambda seed: terrain.s_curve_course(extent, seed), 0.5, profile=profile)


def _slope(name: str, angle_deg: float) -> Scenario:
    path = paths.straight(6.0)
    extent = terrain.extent_of(path)
    rise = 4.0 * math.tan(math.radians(angle_deg))
    profile = ((0.0, 0.0), (1.0, 0.0), (5.0, rise), (6.0, rise))
    return _walk(name, path, lambda seed: terrain.slope(angle_deg, extent), 0.5, profile=profile)


def _stand() -> Scenario:
    extent = (-2.0, 2.0, -2.0, 2.0)
    return Scenario(
        name="stand",
        waypoints=(),
        closed=False,
        speed_mps=0.0,
        start_pose=(0.0, 0.0, 0.0),
        terrain=lambda seed: terrain.flat(extent),
        profile=(),
        nominal_time_s=5.0,
        stand_s=5.0,
    )


def _turn() -> Scenario:
    # Starts looking away from the path by 135 degrees: an in-place turn, then 3 m straight.
    path = paths.straight(3.0)
    return _walk("turn", path, _level(path), 0.6, start_yaw_rad=math.radians(-135.0), time_beside_s=5.0)


_NAMED: dict[str, Callable[[], Scenario]] = {
    "flat": partial(_straight, "flat", 10.0),
    "line-3cm": partial(_line, "line-3cm", 0.03),
    "line-6cm": partial(_line, "line-6cm", 0.06),
    "circle-6cm": _circle,
    "s-curve": _s_curve,
    "slope-up-15": partial(_slope, "slope-up-15", 15.0),
    "slope-down-20": partial(_slope, "slope-down-20", -20.0),
    "push": _push,
    "stand": _stand,
    "turn": _turn,
}
_SLOPE = re.compile(r"slope-(up|down)-([0-9]+(?:\.[0-9]+)?)")
STEEPEST_DEG = 35.0
_STRAIGHT = re.compile(r"straight-([0-9]+(?:\.[0-9]+)?)")
SHORTEST_M, LONGEST_M = 1.0, 100.0


def scenario_names() -> tuple[str, ...]:
    """The names, without the general slopes and straights."""
    return tuple(_NAMED)


def scenario(name: str) -> Scenario:
    """The scenario of this name.

    `slope-up-N` and `slope-down-N` take any angle N up to 35 degrees, `straight-N` any length from 1 m to 100 m.

    Raises:
        UnknownScenarioError: with the names there are, or the bound of the angle or length.
    """
    if name in _NAMED:
        return _NAMED[name]()
    straight = _STRAIGHT.fullmatch(name)
    if straight is not None:
        length = float(straight[1])
        if not SHORTEST_M <= length <= LONGEST_M:
            bounds = f"{SHORTEST_M:g} to {LONGEST_M:g}"
            raise UnknownScenarioError(f"scenario {name!r}: {length:g} m is not from {bounds}")
        return _straight(name, length)
    match = _SLOPE.fullmatch(name)
    if match is None:
        raise UnknownScenarioError(unknown("scenario", name, (*_NAMED, "straight-N", "slope-up-N", "slope-down-N")))
    angle = float(match[2])
    if not 0.0 < angle <= STEEPEST_DEG:
        raise UnknownScenarioError(f"scenario {name!r}: {angle:g} degrees is not above 0 and at most {STEEPEST_DEG:g}")
    return _slope(name, angle if match[1] == "up" else -angle)


def custom(waypoints: paths.Waypoints, speed_mps: float = 0.6, amplitude_m: float = 0.0) -> Scenario:
    """A scenario on waypoints of one's own, on level or undulating ground.

    The ground is level about the first waypoint.

    Raises:
        PathError: if the waypoints are not a path.
        ValueError: if the speed is not positive and finite.
    """
    points = paths.check_waypoints(np.asarray(waypoints, dtype=np.float64))
    if not (math.isfinite(speed_mps) and speed_mps > 0.0):
        raise ValueError(f"custom: speed = {speed_mps} m/s must be positive and finite")
    extent, (x, y) = terrain.extent_of(points), points[0].tolist()
    ground = partial(terrain.undulation, amplitude_m, extent, start=(x, y))
    return _walk("custom", points, ground, speed_mps, time_beside_s=STARTING_AND_STOPPING_S)
