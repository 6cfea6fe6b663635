# SPDX-License-Identifier: Apache-2.0
"""What the MuJoCo models of all robots have in common: contact physics, the ground, shapes, the IMU."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import mujoco

from runtime.models.quadruped import Link
from runtime.robots.simulation import WorldConfig
from sim_bridge.terrain import HeightField

BASE_DEPTH_M = 1.0
BUMPER_M = 0.02
"""Radius of the spheres at the corners of a hull, by which it touches the ground."""
TERRAIN_BIT, ROBOT_BIT = 1, 2
"""Robots touch the ground and nothing of themselves: contacts between their own parts would jam them."""


def new_spec(config: WorldConfig, terrain: HeightField | None) -> mujoco.MjSpec:
    """A model with the contact physics of the specification, and nothing but the ground.

    Args:
        config: contact parameters.
        terrain: the height field, or None for an infinite plane at z = 0.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = config.time_step_ns * 1e-9
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = config.impedance_ratio
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _add_terrain(spec, config.terrain_friction, contact_solref(config), terrain)
    return spec


def contact_solref(config: WorldConfig) -> list[float]:
    """Time constant and damping ratio of every contact, as MuJoCo takes them."""
    return [config.contact_time_s, config.contact_damping_ratio]


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


def set_inertia(body: mujoco.MjsBody, link: Link, left: float = 1.0) -> None:
    """Give a body the mass and inertia of a link."""
    body.explicitinertial = True
    body.mass = link.mass_kg
    body.ipos = link.center(left)
    body.inertia = link.inertia_kg_m2()


def add_shape(body: mujoco.MjsBody, **shape: object) -> None:
    """Add what is seen and touches nothing."""
    body.add_geom(contype=0, conaffinity=0, **shape)


def add_touching(body: mujoco.MjsBody, name: str, solref: list[float], **shape: object) -> None:
    """Add what touches the ground."""
    body.add_geom(name=name, contype=ROBOT_BIT, conaffinity=TERRAIN_BIT, condim=3, solref=solref, **shape)


def add_sphere(
    body: mujoco.MjsBody, name: str, solref: list[float], position: Sequence[float], radius_m: float, **more: object
) -> None:
    """Add a sphere that touches the ground: at one point, where a long shape would have ten."""
    add_touching(body, name, solref, type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=position, size=[radius_m, 0, 0], **more)


def add_hull(body: mujoco.MjsBody, name: str, link: Link, solref: list[float], color: Sequence[float]) -> None:
    """Add a body's mass and its box, of which the corners touch the ground."""
    set_inertia(body, link)
    half = [0.5 * side for side in link.box_m]
    add_shape(body, name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=link.center_m, size=half, rgba=color)
    for number, signs in enumerate(product((-1.0, 1.0), repeat=3)):
        corner = [
            middle + sign * (side - BUMPER_M) for middle, sign, side in zip(link.center_m, signs, half, strict=True)
        ]
        add_sphere(body, f"{name}_corner_{number}", solref, corner, BUMPER_M)


def add_imu(spec: mujoco.MjSpec, body: mujoco.MjsBody, position: Sequence[float]) -> None:
    """Add the sensors of specific force and angular rate: the first six numbers of the sensor data."""
    body.add_site(name="imu", pos=position)
    for name, kind in (("acceleration", mujoco.mjtSensor.mjSENS_ACCELEROMETER), ("rate", mujoco.mjtSensor.mjSENS_GYRO)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
