# SPDX-License-Identifier: Apache-2.0
"""Pure pursuit (paper 000, eq 15-16) on the course instead of the body's yaw."""

from __future__ import annotations

import math

from runtime.models.rotations import wrapped


def pursuit_curvature(x: float, y: float, course: float, target: tuple[float, float]) -> float:
    """Curvature of the arc that leaves (x, y) along the course and meets the target: 1/R = 2 sin(alpha) / l, eq 16.

    Args:
        x: m.
        y: m.
        course: direction of motion, rad.
        target: look-ahead point, m.

    Returns:
        1/m, positive to the left; 0 where the target is reached.
    """
    dx, dy = target[0] - x, target[1] - y
    distance = math.hypot(dx, dy)
    if distance < 1e-6:
        return 0.0
    return 2.0 * math.sin(math.atan2(dy, dx) - course) / distance


def bearing(x: float, y: float, heading: float, target: tuple[float, float]) -> float:
    """Direction of the target relative to the heading, rad in [-pi, pi]."""
    return wrapped(math.atan2(target[1] - y, target[0] - x) - heading)


def drift_angle(course_velocity: tuple[float, float], heading: float, yaw_rate: float, lag_s: float) -> float:
    """Angle from the heading to the course, rad.

    The course is an average over about a gait cycle and so describes the heading of some time ago.

    Args:
        course_velocity: horizontal velocity averaged over a gait cycle, m/s, world.
        heading: now, rad.
        yaw_rate: rad/s.
        lag_s: age of the average: half the length of a plain one, the time constant of a first-order one.
    """
    course = math.atan2(course_velocity[1], course_velocity[0])
    return wrapped(course - (heading - lag_s * yaw_rate))


def low_pass(previous: float, sample: float, dt: float, time_constant: float) -> float:
    """One step of a first-order low-pass filter, exact for a sample held over `dt`."""
    return previous + (sample - previous) * -math.expm1(-dt / time_constant)
