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


def inner_angle(curvature: float, geometry: VehicleGeometry) -> float:
    """Steering angle of the front inner wheel in dual Ackermann steering, rad, positive (eq 1)."""
    bend = abs(curvature)
    return math.atan2(geometry.wheelbase_m * bend, 2.0 - geometry.track_m * bend)
