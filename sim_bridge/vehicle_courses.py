# SPDX-License-Identifier: Apache-2.0
"""The scenarios of a vehicle on wheels, by name: those of paper 002, and what four steered wheels can do besides."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from runtime.errors import unknown
from runtime.tracking import bends, paths
from runtime.tracking.sections import SectionedPath
from runtime.tracking.waypoints import check_cusped_waypoints
from sim_bridge import terrain
from sim_bridge.ground_friction import FrictionPatch
from sim_bridge.scenario import Scenario, UnknownScenarioError
from sim_bridge.terrain import HeightField

SPEED_MPS = 0.6
MARGIN_M = 3.0
"""Level ground about a path."""
STARTING_AND_STOPPING_S = 4.0
STEERING_S = 4.0
"""For wheels that are turned by a quarter before the vehicle starts."""
SLIPPERY = 0.3
"""Friction of the slippery patch."""
PATCH_MARGIN_M = 1.0
"""Of a patch, beyond a bend that lies on it: more than half the vehicle's length."""
RUN_UP_M, BETWEEN_M = 10.0, 4.0
"""Straights before the first and after the last of two bends, for a vehicle that takes them fast; and between them."""

Ground = Callable[[int], HeightField]


def _drive(
    name: str,
    waypoints: paths.Waypoints,
    *,
    aside_m: float = 0.0,
    closed: bool = False,
    ground: Ground | None = None,
    speed_mps: float = SPEED_MPS,
    start_and_stop_s: float = STARTING_AND_STOPPING_S,
) -> Scenario:
    """A path to be followed, from a start at its beginning or aside of it, to the left, parallel to it.

    Where it turns back at cusps, the vehicle starts and stops once a section.
    """
    path = SectionedPath(waypoints, closed)
    yaw = path.sections[0].heading(0.0)
    (x, y), extent = waypoints[0].tolist(), terrain.extent_of(waypoints, MARGIN_M)
    time_beside_s = len(path.sections) * start_and_stop_s
    return Scenario(
        name=name,
        waypoints=tuple((x, y) for x, y in waypoints.tolist()),
        closed=closed,
        speed_mps=speed_mps,
        start_pose=(x - aside_m * math.sin(yaw), y + aside_m * math.cos(yaw), yaw),
        terrain=ground or (lambda seed: terrain.flat(extent)),
        profile=((0.0, 0.0), (path.length, 0.0)),
        nominal_time_s=path.length / speed_mps + time_beside_s,
        time_beside_s=time_beside_s,
    )


def _straight(name: str, length_m: float, aside_m: float = 0.0) -> Scenario:
    return _drive(name, paths.straight(length_m), aside_m=aside_m)


def _curve(shape: str) -> Scenario:
    """Paper 002's curve experiment: 40 m from 1 m beside the path."""
    return _drive(f"curve-{shape}", bends.CURVES[shape](), aside_m=1.0)


def _s_curve() -> Scenario:
    return _drive("s-curve", bends.s_bend())


def _slalom() -> Scenario:
    there, back = bends.arc(45.0), bends.arc(-45.0)
    gate = (there, back, back, there)
    return _drive("slalom", bends.path_of_bends((bends.Bend(2.0), *gate, *gate, *gate, bends.Bend(2.0))))


def _figure_eight() -> Scenario:
    return _drive("figure-eight", bends.figure_eight(), closed=True)


def _three_point_turn() -> Scenario:
    return _drive("three-point-turn", bends.three_point_turn())


def _slope(name: str, angle_deg: float) -> Scenario:
    path = paths.straight(6.0)
    ground = partial(_sloping, angle_deg, terrain.extent_of(path, MARGIN_M))
    rise = 4.0 * math.tan(math.radians(angle_deg))
    profile = ((0.0, 0.0), (1.0, 0.0), (5.0, rise), (6.0, rise))
    return replace(_drive(name, path, ground=ground), profile=profile)


def _sloping(angle_deg: float, extent: terrain.Extent, seed: int) -> HeightField:
    return terrain.slope(angle_deg, extent)


def _rough(name: str, amplitude_m: float) -> Scenario:
    path = paths.straight(10.0)
    return _drive(name, path, ground=partial(terrain.undulation, amplitude_m, terrain.extent_of(path, MARGIN_M)))


def _slippery() -> Scenario:
    patch = FrictionPatch((4.0, 7.0), (-3.0, 3.0), SLIPPERY)
    return replace(_straight("slippery", 12.0), patches=(patch,))


def _slippery_bend() -> Scenario:
    """Two quarter bends, of which the first lies on a slippery patch; both are as tight as the paper's."""
    quarter = bends.arc(90.0)
    path = bends.path_of_bends(
        (bends.Bend(RUN_UP_M), quarter, bends.Bend(BETWEEN_M), bends.arc(-90.0), bends.Bend(RUN_UP_M))
    )
    radius_m = 1.0 / quarter.curvature
    patch = FrictionPatch(
        (RUN_UP_M - PATCH_MARGIN_M, RUN_UP_M + radius_m + PATCH_MARGIN_M),
        (-PATCH_MARGIN_M, radius_m + PATCH_MARGIN_M),
        SLIPPERY,
    )
    return replace(_drive("slippery-bend", path), patches=(patch,))


def _asked(name: str, velocity: tuple[float, float, float], length_m: float) -> Scenario:
    """A straight way that the operator drives by velocity, in whatever direction of the vehicle."""
    forward, lateral, _ = velocity
    speed = math.hypot(forward, lateral)
    goal = length_m * np.array([forward, lateral]) / speed
    path = np.array([(0.0, 0.0), goal])
    made = _drive(name, path, speed_mps=speed, start_and_stop_s=STARTING_AND_STOPPING_S + STEERING_S)
    return replace(made, start_pose=(0.0, 0.0, 0.0), velocity=velocity)


def _spin() -> Scenario:
    turn, yaw_rate = 2.0 * math.pi, 0.5
    return replace(
        _still("spin"),
        velocity=(0.0, 0.0, yaw_rate),
        turn_rad=turn,
        nominal_time_s=turn / yaw_rate + STARTING_AND_STOPPING_S + STEERING_S,
    )


def _still(name: str) -> Scenario:
    extent = (-MARGIN_M, MARGIN_M, -MARGIN_M, MARGIN_M)
    return Scenario(
        name=name,
        waypoints=(),
        closed=False,
        speed_mps=0.0,
        start_pose=(0.0, 0.0, 0.0),
        terrain=lambda seed: terrain.flat(extent),
        profile=(),
        nominal_time_s=3.0,
        stand_s=3.0,
    )


_NAMED: dict[str, Callable[[], Scenario]] = {
    "flat": partial(_straight, "flat", 10.0),
    "straight": partial(_straight, "straight", 20.0, aside_m=1.5),
    **{f"curve-{shape}": partial(_curve, shape) for shape in bends.CURVES},
    "s-curve": _s_curve,
    "figure-eight": _figure_eight,
    "slalom": _slalom,
    "three-point-turn": _three_point_turn,
    "crab": partial(_asked, "crab", (0.0, 0.4, 0.0), 4.0),
    "diagonal": partial(_asked, "diagonal", (0.4, 0.4, 0.0), 5.0),
    "reverse": partial(_asked, "reverse", (-0.5, 0.0, 0.0), 5.0),
    "spin": _spin,
    "slope-up-10": partial(_slope, "slope-up-10", 10.0),
    "slope-down-10": partial(_slope, "slope-down-10", -10.0),
    "rough-3cm": partial(_rough, "rough-3cm", 0.03),
    "slippery": _slippery,
    "slippery-bend": _slippery_bend,
    "stand": partial(_still, "stand"),
}
CURVE = "curve"
"""The seed chooses among the five shapes."""
_STRAIGHT = re.compile(r"straight-([0-9]+(?:\.[0-9]+)?)")
SHORTEST_M, LONGEST_M = 1.0, 100.0


def scenario_names() -> tuple[str, ...]:
    """The names, without `curve` and the general straights."""
    return tuple(_NAMED)


def scenario(name: str, seed: int = 0) -> Scenario:
    """The scenario of this name.

    `curve` takes the seed's of the five shapes, `straight-N` any length from 1 m to 100 m, on the path.

    Raises:
        UnknownScenarioError: with the names there are, or the bound of the length.
    """
    if name == CURVE:
        return _curve(tuple(bends.CURVES)[seed % len(bends.CURVES)])
    if name in _NAMED:
        return _NAMED[name]()
    straight = _STRAIGHT.fullmatch(name)
    if straight is None:
        raise UnknownScenarioError(unknown("scenario", name, (*_NAMED, CURVE, "straight-N")))
    length = float(straight[1])
    if not SHORTEST_M <= length <= LONGEST_M:
        raise UnknownScenarioError(f"scenario {name!r}: {length:g} m is not from {SHORTEST_M:g} to {LONGEST_M:g}")
    return _straight(name, length)


def custom(waypoints: paths.Waypoints) -> Scenario:
    """A scenario on waypoints of one's own, on level ground; where they turn back, the vehicle goes on backwards.

    Raises:
        PathError: if the waypoints are not a path.
    """
    return _drive("custom", check_cusped_waypoints(np.asarray(waypoints, dtype=np.float64)))
