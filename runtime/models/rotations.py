# SPDX-License-Identifier: Apache-2.0
"""Rotations, one at a time: quaternions (x, y, z, w), roll-pitch-yaw (R = Rz Ry Rx), SO(3) logarithm."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]


@compiled
def matrix_of_quaternion(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@compiled
def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton product: the rotation b followed, in the parent frame, by a."""
    ax, ay, az, aw = a[0], a[1], a[2], a[3]
    bx, by, bz, bw = b[0], b[1], b[2], b[3]
    return np.array(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


@compiled
def normalized(vector: Array) -> Array:
    """The vector or quaternion of unit length."""
    square = 0.0
    for part in vector:
        square += part * part
    return vector / math.sqrt(square)


@compiled
def quaternion_of_vector(rotation: Array) -> Array:
    """Quaternion of a rotation vector (exponential map)."""
    x, y, z = rotation[0], rotation[1], rotation[2]
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    scale = math.sin(half) / angle if angle > 1e-9 else 0.5
    return np.array([x * scale, y * scale, z * scale, math.cos(half)])


@compiled
def quaternion_of_yaw(yaw: float) -> Array:
    """Quaternion of a rotation about z."""
    return np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)])


@compiled
def yaw_of_quaternion(quaternion: Array) -> float:
    """Yaw angle in (-pi, pi]."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@compiled
def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation matrix."""
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        math.asin(max(-1.0, min(1.0, -rotation[2, 0]))),
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )


@compiled
def rotation_z(yaw: float) -> Array:
    """Rotation matrix about z (T_z of paper 000)."""
    s, c = math.sin(yaw), math.cos(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@compiled
def rotation_vector(rotation: Array) -> Array:
    """SO(3) logarithm: the rotation vector of a rotation matrix (angle below pi)."""
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    angle = math.acos(max(-1.0, min(1.0, 0.5 * (trace - 1.0))))
    sine = math.sin(angle)
    scale = 0.5 if angle < 1e-6 or sine < 1e-9 else 0.5 * angle / sine
    return np.array(
        [
            scale * (rotation[2, 1] - rotation[1, 2]),
            scale * (rotation[0, 2] - rotation[2, 0]),
            scale * (rotation[1, 0] - rotation[0, 1]),
        ]
    )


@compiled
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi]."""
    rest = np.fmod(angle, math.tau)
    if rest > math.pi:
        return rest - math.tau
    return rest + math.tau if rest < -math.pi else rest


@compiled
def aligned_with_plane(yaw: float, normal: Array) -> Array:
    """Rotation (3, 3) whose z axis is the plane's normal and whose x axis has the given heading, seen from above."""
    nx, ny, nz = normal[0], normal[1], normal[2]
    x, y = math.cos(yaw), math.sin(yaw)
    z = -(nx * x + ny * y) / nz
    scale = 1.0 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * scale, y * scale, z * scale
    return np.array(
        [
            [x, ny * z - nz * y, nx],
            [y, nz * x - nx * z, ny],
            [z, nx * y - ny * x, nz],
        ]
    )
