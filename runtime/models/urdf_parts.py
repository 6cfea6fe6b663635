# SPDX-License-Identifier: Apache-2.0
"""The pieces of which a URDF document is made."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring


def document(robot: Element) -> str:
    """The text of a robot."""
    indent(robot)
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode") + "\n"


def add_inertial(link: Element, mass_kg: float, center: Sequence[float], moments: Sequence[float]) -> None:
    """Give a link its mass, its centre (3,), and its moments of inertia (3,) about the axes there."""
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=text(center))
    SubElement(inertial, "mass", value=repr(mass_kg))
    values = dict(zip(("ixx", "iyy", "izz"), map(repr, moments), strict=True))
    SubElement(inertial, "inertia", values | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))


def add_box(link: Element, center: Sequence[float], size: Sequence[float]) -> None:
    """Draw a link as a box."""
    visual = SubElement(link, "visual")
    SubElement(visual, "origin", xyz=text(center))
    SubElement(SubElement(visual, "geometry"), "box", size=text(size))


def add_joint(robot: Element, name: str, kind: str, parent: str, child: str, offset: Sequence[float]) -> Element:
    """Join two links; the joint lies at `offset` (3,) in the parent's frame."""
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=text(offset))
    return joint


def text(numbers: Sequence[float]) -> str:
    """Numbers as an attribute."""
    return " ".join(repr(float(number)) for number in numbers)
