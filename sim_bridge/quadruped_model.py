# SPDX-License-Identifier: Apache-2.0
"""The MuJoCo model of a quadruped on a terrain, with the contact physics of the specification."""

from __future__ import annotations

import mujoco
import numpy as np

from runtime.models.quadruped import AXES, FEET, LEFT, LEG_JOINTS, Quadruped
from runtime.robots.simulation import SimulationConfig
from sim_bridge.model_parts import add_hull, add_imu, add_shape, add_sphere, contact_solref, new_spec, set_inertia
from sim_bridge.terrain import HeightField

TRUNK_COLOR, LEG_COLOR = [0.25, 0.27, 0.30, 1.0], [0.85, 0.45, 0.15, 1.0]


def build(description: Quadruped, config: SimulationConfig, terrain: HeightField | None) -> mujoco.MjModel:
    """Compile the model.

    Args:
        description: geometry and masses of the robot.
        config: contact parameters and joint friction.
        terrain: the height field, or None for an infinite plane at z = 0.
    """
    spec, solref = new_spec(config, terrain), contact_solref(config)
    trunk = spec.worldbody.add_body(name="trunk", pos=[0, 0, 0.5])
    trunk.add_freejoint(name="trunk")
    add_hull(trunk, "trunk", description.trunk, solref, TRUNK_COLOR)
    for leg in range(len(FEET)):
        _add_leg(trunk, leg, description, config, solref)
    add_imu(spec, trunk, [0.0, 0.0, 0.0])
    return spec.compile()


def _add_leg(
    trunk: mujoco.MjsBody, leg: int, description: Quadruped, config: SimulationConfig, solref: list[float]
) -> None:
    foot, left = FEET[leg], LEFT[leg]
    offsets = (
        description.hip_positions()[leg],
        [0.0, left * description.abad_length_m, 0.0],
        [0.0, 0.0, -description.thigh_length_m],
    )
    parent = trunk
    for name, axis, offset, link in zip(
        LEG_JOINTS, AXES, offsets, (description.abad, description.thigh, description.shank), strict=True
    ):
        parent = parent.add_body(name=f"{foot}_{name}", pos=offset)
        parent.add_joint(
            name=f"{foot}_{name}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            armature=description.armature_kg_m2,
            damping=np.array([config.joint_viscous_nms_prad, 0, 0]),
            frictionloss=config.joint_coulomb_nm,
        )
        set_inertia(parent, link, left)
        if name != "abad":
            length = description.thigh_length_m if name == "hip" else description.shank_length_m
            thickness = 0.6 * description.foot_radius_m
            add_shape(
                parent,
                name=f"{foot}_{name}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0, 0, 0, 0, 0, -length],
                size=[thickness, 0, 0],
                rgba=LEG_COLOR,
            )
            # the upper end and the middle; the lower end is the next link's upper one, or the foot
            for place, share in (("top", 0.0), ("middle", 0.5)):
                add_sphere(parent, f"{foot}_{name}_{place}", solref, [0, 0, -share * length], thickness)
    add_sphere(
        parent,
        f"{foot}_foot",
        solref,
        [0, 0, -description.shank_length_m],
        description.foot_radius_m,
        friction=[0.1, 0.005, 0.0001],
        rgba=[0.1, 0.1, 0.1, 1],
    )
