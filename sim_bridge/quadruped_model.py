# SPDX-License-Identifier: Apache-2.0
"""The MuJoCo model of a quadruped on a terrain, with the contact physics of the specification."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import mujoco
import numpy as np

from runtime.models.quadruped import AXES, FEET, LEFT, LEG_JOINTS, Link, Quadruped
from runtime.robots.simulation import SimulationConfig
from sim_bridge.terrain import HeightField

BASE_DEPTH_M = 1.0
TERRAIN_BIT, ROBOT_BIT = 1, 2
BUMPER_M = 0.02
"""Radius of the spheres at the corners of the trunk, by which it touches the ground."""
TRUNK_COLOR, LEG_COLOR = [0.25, 0.27, 0.30, 1.0], [0.85, 0.45, 0.15, 1.0]


def build(description: Quadruped, config: SimulationConfig, terrain: HeightField | None) -> mujoco.MjModel:
    """Compile the model.

    Args:
        description: geometry and masses of the robot.
        config: contact parameters and joint friction.
        terrain: the height field, or None for an infinite plane at z = 0.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = config.time_step_ns * 1e-9
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = config.impedance_ratio
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    solref = [config.contact_time_s, config.contact_damping_ratio]
    _add_terrain(spec, config.terrain_friction, solref, terrain)
    trunk = spec.worldbody.add_body(name="trunk", pos=[0, 0, 0.5])
    trunk.add_freejoint(name="trunk")
    trunk.add_site(name="imu")
    _set_inertia(trunk, description.trunk, 1.0)
    half = [0.5 * side for side in description.trunk.box_m]
    _add_shape(
        trunk, name="trunk", type=mujoco.mjtGeom.mjGEOM_BOX, pos=description.trunk.center_m, size=half, rgba=TRUNK_COLOR
    )
    for number, signs in enumerate(product((-1.0, 1.0), repeat=3)):
        corner = [
            middle + sign * (side - BUMPER_M)
            for middle, sign, side in zip(description.trunk.center_m, signs, half, strict=True)
        ]
        _add_sphere(trunk, f"trunk_corner_{number}", solref, corner, BUMPER_M)
    for leg in range(len(FEET)):
        _add_leg(trunk, leg, description, config, solref)
    spec.add_sensor(
        name="acceleration", type=mujoco.mjtSensor.mjSENS_ACCELEROMETER, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu"
    )
    spec.add_sensor(name="rate", type=mujoco.mjtSensor.mjSENS_GYRO, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    return spec.compile()


def _add_terrain(spec: mujoco.MjSpec, friction: float, solref: list[float], terrain: HeightField | None) -> None:
    surface = {
        "name": "terrain",
        "friction": [friction, 0.005, 0.0001],
        "solref": solref,
        "condim": 3,
        "contype": TERRAIN_BIT,
        "conaffinity": ROBOT_BIT,
        "rgba": [0.55, 0.50, 0.42, 1],
    }
    spec.worldbody.add_light(pos=[0, 0, 5], dir=[0.3, 0.2, -1], castshadow=False)
    if terrain is None:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], **surface)
        return
    rows, columns = terrain.heights_m.shape
    low, high = float(terrain.heights_m.min()), float(terrain.heights_m.max())
    span = max(high - low, 1e-6)
    half = (0.5 * (columns - 1) * terrain.spacing_m, 0.5 * (rows - 1) * terrain.spacing_m)
    spec.add_hfield(
        name="terrain",
        nrow=rows,
        ncol=columns,
        size=[half[0], half[1], span, BASE_DEPTH_M],
        userdata=((terrain.heights_m - low) / span).ravel(),
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="terrain",
        pos=[terrain.x_origin_m + half[0], terrain.y_origin_m + half[1], low],
        **surface,
    )


def _set_inertia(body: mujoco.MjsBody, link: Link, left: float) -> None:
    body.explicitinertial = True
    body.mass = link.mass_kg
    body.ipos = link.center(left)
    body.inertia = link.inertia_kg_m2()


def _add_shape(body: mujoco.MjsBody, **shape: object) -> None:
    """What is seen and touches nothing."""
    body.add_geom(contype=0, conaffinity=0, **shape)


def _add_sphere(
    body: mujoco.MjsBody, name: str, solref: list[float], position: Sequence[float], radius_m: float, **more: object
) -> None:
    """What touches the ground: a sphere has one point of contact with it, where a long shape would have ten."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=position,
        size=[radius_m, 0, 0],
        contype=ROBOT_BIT,
        conaffinity=TERRAIN_BIT,
        condim=3,
        solref=solref,
        **more,
    )


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
        _set_inertia(parent, link, left)
        if name != "abad":
            length = description.thigh_length_m if name == "hip" else description.shank_length_m
            thickness = 0.6 * description.foot_radius_m
            _add_shape(
                parent,
                name=f"{foot}_{name}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0, 0, 0, 0, 0, -length],
                size=[thickness, 0, 0],
                rgba=LEG_COLOR,
            )
            # the upper end and the middle; the lower end is the next link's upper one, or the foot
            for place, share in (("top", 0.0), ("middle", 0.5)):
                _add_sphere(parent, f"{foot}_{name}_{place}", solref, [0, 0, -share * length], thickness)
    _add_sphere(
        parent,
        f"{foot}_foot",
        solref,
        [0, 0, -description.shank_length_m],
        description.foot_radius_m,
        friction=[0.1, 0.005, 0.0001],
        rgba=[0.1, 0.1, 0.1, 1],
    )
