# SPDX-License-Identifier: Apache-2.0
"""Where the trunk should be over the horizon: along the stance plane, at the commanded velocity and yaw rate."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.models.rotations import aligned_with_plane, roll_pitch_yaw

Array = npt.NDArray[np.float64]


class Ground(NamedTuple):
    """The stance plane below the robot.

    Attributes:
        point: a point on it, (3,), m, in odom.
        normal: its unit normal, (3,).
    """

    point: Array
    normal: Array


class Demand(NamedTuple):
    """What is asked of the trunk: forward and lateral velocity along the plane, m/s, and yaw rate, rad/s."""

    forward: float
    lateral: float
    yaw_rate: float


@compiled
def height_of(ground: Ground, x: float, y: float) -> float:
    """Height of the plane at a horizontal position."""
    point, normal = ground.point, ground.normal
    return float(point[2] - ((x - point[0]) * normal[0] + (y - point[1]) * normal[1]) / normal[2])


@compiled
def advanced(reference_xy: Array, present_xy: Array, velocity: Array, seconds: float, clamp_m: float) -> Array:
    """The horizontal reference moved on by its velocity, and drawn back to within `clamp_m` of the robot."""
    away = reference_xy + velocity * seconds - present_xy
    return present_xy + away * min(1.0, clamp_m / max(math.hypot(away[0], away[1]), 1e-9))


@compiled
def velocity_along(plane: Array, demand: Demand) -> Array:
    """The demanded velocity (3,) in odom, for plane axes whose x axis has the reference heading."""
    return plane[:, 0] * demand.forward + plane[:, 1] * demand.lateral


@compiled
def reference_states(
    begin_xy: Array, yaw: float, demand: Demand, ground: Ground, height_m: float, durations: Array
) -> Array:
    """Reference states (N, 12) at the ends of the horizon's steps, ordered as the MPC's state.

    Args:
        begin_xy: horizontal reference of the centre of mass at the begin, m.
        yaw: reference heading at the begin, rad, unwrapped towards the present one.
        demand: held over the horizon.
        ground: the stance plane.
        height_m: of the centre of mass above the plane, along world z.
        durations: of the steps, (N,), s.
    """
    plane = aligned_with_plane(yaw, ground.normal)
    roll, pitch, _ = roll_pitch_yaw(plane)
    states, end = np.zeros((durations.shape[0], 12)), 0.0
    x, y = begin_xy[0], begin_xy[1]
    for step in range(durations.shape[0]):
        turn = demand.yaw_rate * (end + 0.5 * durations[step])
        cosine, sine = math.cos(turn), math.sin(turn)
        forward = cosine * demand.forward - sine * demand.lateral
        lateral = sine * demand.forward + cosine * demand.lateral
        velocity = velocity_along(plane, Demand(forward, lateral, demand.yaw_rate))
        end += durations[step]
        x, y = x + velocity[0] * durations[step], y + velocity[1] * durations[step]
        states[step, 0], states[step, 1], states[step, 2] = roll, pitch, yaw + demand.yaw_rate * end
        states[step, 3], states[step, 4], states[step, 5] = x, y, height_of(ground, x, y) + height_m
        states[step, 8] = demand.yaw_rate
        states[step, 9:] = velocity
    return states
