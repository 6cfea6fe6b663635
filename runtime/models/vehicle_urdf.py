# SPDX-License-Identifier: Apache-2.0
"""A vehicle as URDF, for those who look at it from outside: a chassis, four steering axes, four wheels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from runtime.models.urdf_parts import add_box, add_inertial, add_joint, document
from runtime.models.vehicle import WHEELS, Vehicle

_HERE = (0.0, 0.0, 0.0)
_QUARTER = 0.5 * math.pi
_ROUND = (0.05, 0.1)
"""Radius and height of a knuckle as URDF has it, m."""


def vehicle_urdf(description: Vehicle, name: str, base: str, wheel_radps: float) -> str:
    """The description as text.

    Args:
        description: geometry and masses.
        name: of the robot.
        base: name of the chassis' link; its origin is at the centre, on the ground.
        wheel_radps: largest speed of a wheel.
    """
    robot = Element("robot", name=name)
    chassis, reach = description.chassis, description.steering_range_rad
    body = SubElement(robot, "link", name=base)
    add_inertial(body, chassis.mass_kg, chassis.center_m, chassis.inertia_kg_m2().tolist())
    add_box(body, chassis.center_m, chassis.box_m)
    radius, width = description.wheel_radius_m, description.wheel_width_m
    for wheel, (x, y) in zip(WHEELS, description.wheel_positions().tolist(), strict=True):
        knuckle = SubElement(robot, "link", name=f"{wheel}_knuckle")
        add_inertial(
            knuckle, description.knuckle_mass_kg, (0.0, 0.0, 0.0), _of_cylinder(description.knuckle_mass_kg, *_ROUND)
        )
        axis = add_joint(robot, f"{wheel}_steering", "revolute", base, f"{wheel}_knuckle", (x, y, radius))
        SubElement(axis, "axis", xyz="0 0 1")
        SubElement(axis, "limit", lower=repr(-reach), upper=repr(reach), effort="0", velocity="0")
        rim = SubElement(robot, "link", name=f"{wheel}_link")
        add_inertial(
            rim, description.wheel_mass_kg, (0.0, 0.0, 0.0), _of_cylinder(description.wheel_mass_kg, radius, width)
        )
        visual = SubElement(rim, "visual")
        SubElement(visual, "origin", rpy=f"{_QUARTER!r} 0 0")
        SubElement(SubElement(visual, "geometry"), "cylinder", radius=repr(radius), length=repr(width))
        axle = add_joint(robot, f"{wheel}_wheel", "continuous", f"{wheel}_knuckle", f"{wheel}_link", _HERE)
        SubElement(axle, "axis", xyz="0 1 0")
        SubElement(axle, "limit", effort="0", velocity=repr(wheel_radps))
    return document(robot)


def _of_cylinder(mass: float, radius: float, width: float) -> Sequence[float]:
    """Moments of inertia of a cylinder about y."""
    across = mass * (3.0 * radius**2 + width**2) / 12.0
    return across, 0.5 * mass * radius**2, across
