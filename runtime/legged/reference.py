# SPDX-License-Identifier: Apache-2.0
"""Where the trunk should be over the horizon: along the stance plane, at the commanded velocity and yaw rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

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

    def height_at(self, xy: Array) -> Array:
        """Height of the plane at horizontal positions (n, 2)."""
        slope = self.normal[:2] / self.normal[2]
        return np.asarray(self.point[2] - (xy - self.point[:2]) @ slope)


class Demand(NamedTuple):
    """What is asked of the trunk: forward and lateral velocity along the plane, m/s, and yaw rate, rad/s."""

    forward: float
    lateral: float
    yaw_rate: float


def advanced(reference_xy: Array, present_xy: Array, velocity: Array, seconds: float, clamp_m: float) -> Array:
    """The horizontal reference moved on by its velocity, and drawn back to within `clamp_m` of the robot."""
    away = reference_xy + velocity * seconds - present_xy
    return np.asarray(present_xy + away * min(1.0, clamp_m / max(float(np.hypot(away[0], away[1])), 1e-9)))


def velocity_along(plane: Array, demand: Demand) -> Array:
    """The demanded velocity (3,) in odom, for plane axes whose x axis has the reference heading."""
    return np.asarray(plane[:, 0] * demand.forward + plane[:, 1] * demand.lateral)


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
    ends = np.cumsum(durations)
    plane = aligned_with_plane(yaw, ground.normal)
    turns = demand.yaw_rate * (ends - 0.5 * durations)
    cosine, sine = np.cos(turns), np.sin(turns)
    forward = cosine * demand.forward - sine * demand.lateral
    lateral = sine * demand.forward + cosine * demand.lateral
    velocity = np.outer(forward, plane[:, 0]) + np.outer(lateral, plane[:, 1])
    states = np.zeros((durations.shape[0], 12))
    states[:, 0], states[:, 1], _ = roll_pitch_yaw(plane)
    states[:, 2] = yaw + demand.yaw_rate * ends
    states[:, 3:5] = begin_xy + np.cumsum(velocity[:, :2] * durations[:, None], axis=0)
    states[:, 5] = ground.height_at(states[:, 3:5]) + height_m
    states[:, 8] = demand.yaw_rate
    states[:, 9:] = velocity
    return states
