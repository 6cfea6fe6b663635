# SPDX-License-Identifier: Apache-2.0
"""Curvature of the centre's path, and the steering angles that make it when front and rear wheels steer opposite."""

from __future__ import annotations

import math

from runtime.models.vehicle import VehicleGeometry


def centre_angle(curvature: float, wheelbase_m: float) -> float:
    """Steering angle of the front centre wheel of the equivalent bicycle, rad: tan(delta) = L kappa / 2."""
    return math.atan(0.5 * wheelbase_m * curvature)


def centre_curvature(angle: float, wheelbase_m: float) -> float:
    """Curvature of the centre's path at a centre angle, 1/m; the rear wheels steer opposite."""
    return 2.0 * math.tan(angle) / wheelbase_m


def wheel_centre_angle(angle: float, lateral_m: float, wheelbase_m: float) -> float:
    """Centre angle of the arc that a front wheel rolls on, rad.

    The wheel's cotangent is that of the centre less 2 y / L: the inner wheel steers further. Written so that it holds
    at zero and beyond a quarter turn. A rear wheel is a front one that steers the other way.

    Args:
        angle: steering angle of the wheel, rad, positive to the left.
        lateral_m: y, of the wheel, positive to the left.
        wheelbase_m: L.
    """
    return math.atan2(math.sin(angle), math.cos(angle) + 2.0 * lateral_m / wheelbase_m * math.sin(angle))


def inner_angle(curvature: float, geometry: VehicleGeometry) -> float:
    """Steering angle of the front inner wheel in dual Ackermann steering, rad, positive (eq 1)."""
    bend = abs(curvature)
    return math.atan2(geometry.wheelbase_m * bend, 2.0 - geometry.track_m * bend)
