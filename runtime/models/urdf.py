# SPDX-License-Identifier: Apache-2.0
"""A quadruped as URDF, for those who look at it from outside: the same bodies and joints as the rigid-body model's.

A link is drawn as the box that has its inertia, a foot as a ball. Rotor inertia has no place in URDF.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

import numpy as np
import numpy.typing as npt

from runtime.models.quadruped import AXES, FEET, LEFT, LEG_JOINTS, Link, Quadruped
from runtime.models.urdf_parts import add_box, add_inertial, add_joint, document, text

Array = npt.NDArray[np.float64]


def quadruped_urdf(
    description: Quadruped, name: str, base: str, bounds: tuple[Array, Array], effort_nm: float, velocity_radps: float
) -> str:
    """The description as text.

    Args:
        description: geometry and masses.
        name: of the robot.
        base: name of the trunk's link.
        bounds: lowest and highest angle of every joint, rad.
        effort_nm: largest torque of every joint.
        velocity_radps: largest velocity of every joint.
    """
    robot = Element("robot", name=name)
    _link(robot, base, description.trunk, 1.0)
    links = (description.abad, description.thigh, description.shank)
    for leg, foot in enumerate(FEET):
        offsets = (
            description.hip_positions()[leg].tolist(),
            (0.0, float(LEFT[leg]) * description.abad_length_m, 0.0),
            (0.0, 0.0, -description.thigh_length_m),
        )
        parent = base
        for part, (joint, axis, offset, link) in enumerate(zip(LEG_JOINTS, AXES, offsets, links, strict=True)):
            child = f"{foot}_{joint}_link"
            _link(robot, child, link, float(LEFT[leg]))
            row = add_joint(robot, f"{foot}_{joint}", "revolute", parent, child, offset)
            SubElement(row, "axis", xyz=text(axis.tolist()))
            low, high = (float(bound[len(LEG_JOINTS) * leg + part]) for bound in bounds)
            limits = {"lower": low, "upper": high, "effort": effort_nm, "velocity": velocity_radps}
            SubElement(row, "limit", {key: repr(float(value)) for key, value in limits.items()})
            parent = child
        ball = SubElement(SubElement(SubElement(robot, "link", name=f"{foot}_foot"), "visual"), "geometry")
        SubElement(ball, "sphere", radius=repr(description.foot_radius_m))
        add_joint(robot, f"{foot}_sole", "fixed", parent, f"{foot}_foot", (0.0, 0.0, -description.shank_length_m))
    return document(robot)


def _link(robot: Element, name: str, body: Link, left: float) -> None:
    link = SubElement(robot, "link", name=name)
    center = body.center(left).tolist()
    add_inertial(link, body.mass_kg, center, body.inertia_kg_m2().tolist())
    add_box(link, center, body.box_m)
