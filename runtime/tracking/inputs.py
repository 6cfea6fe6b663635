# SPDX-License-Identifier: Apache-2.0
"""What the tracker takes from its signals."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.signals import Path
from runtime.tracking.errors import PathError

Array = npt.NDArray[np.float64]
LEAST_SQUARED_NORM = 0.25
"""Of a quaternion that was written, and only roughly normed; one that never was is all zeros."""


def planar_pose(position: Array, orientation: Array, *others: Array) -> tuple[float, float, float] | None:
    """Position and yaw, or None where the state is not finite or was never written.

    Args:
        position: x, y, z, m.
        orientation: quaternion x, y, z, w.
        others: what else of the state is relied on.
    """
    x, y, z = position.tolist()
    i, j, k, w = orientation.tolist()
    values = (x, y, z, i, j, k, w, *(value for other in others for value in other.tolist()))
    if not all(map(math.isfinite, values)) or i * i + j * j + k * k + w * w < LEAST_SQUARED_NORM:
        return None
    return x, y, math.atan2(2.0 * (w * k + i * j), w * w + i * i - j * j - k * k)


def waypoints_of(path: Path) -> Array:
    """The waypoints of the path signal, n x 2, m.

    Raises:
        PathError: if it claims more than there can be, or its speed is none.
    """
    if path.count > len(path.x):
        raise PathError(f"{path.topic}: the path claims {path.count} points, at most {len(path.x)} fit")
    if not (math.isfinite(path.speed) and path.speed > 0.0):
        raise PathError(f"{path.topic}: speed = {path.speed} m/s must be positive and finite")
    return np.column_stack((path.x[: path.count], path.y[: path.count]))
