# SPDX-License-Identifier: Apache-2.0
"""What the tracker takes from its signals."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.signals import BodyState, Path
from runtime.tracking.errors import PathError


def planar_pose(body: BodyState) -> tuple[float, float, float] | None:
    """Position and yaw, or None where the state is not finite or was never written."""
    x, y, z = body.position.tolist()
    i, j, k, w = body.orientation.tolist()
    rates = (*body.course_velocity.tolist(), *body.angular_velocity.tolist(), *body.plane_normal.tolist())
    values = (x, y, z, i, j, k, w, *rates)
    if not all(map(math.isfinite, values)) or i * i + j * j + k * k + w * w < 0.25:
        return None
    return x, y, math.atan2(2.0 * (w * k + i * j), w * w + i * i - j * j - k * k)


def waypoints_of(path: Path) -> npt.NDArray[np.float64]:
    """The waypoints of the path signal, n x 2, m.

    Raises:
        PathError: if it claims more than there can be, or its speed is none.
    """
    if path.count > len(path.x):
        raise PathError(f"{path.topic}: the path claims {path.count} points, at most {len(path.x)} fit")
    if not (math.isfinite(path.speed) and path.speed > 0.0):
        raise PathError(f"{path.topic}: speed = {path.speed} m/s must be positive and finite")
    return np.column_stack((path.x[: path.count], path.y[: path.count]))
