# SPDX-License-Identifier: Apache-2.0
"""The MuJoCo model of a vehicle with four steered and driven wheels on a terrain.

Each wheel hangs on a knuckle that slides along its suspension and turns about the vertical; the wheel turns in it. The
chassis is the knuckle's parent but the wheel's grandparent, so MuJoCo would let a wheel that overlaps it jam the
vehicle: nothing of the vehicle touches anything of it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from runtime.models.vehicle import WHEELS, Vehicle
from runtime.robots.vehicle_simulation import VehicleSimulationConfig
from sim_bridge.model_parts import add_hull, add_imu, add_shape, add_sphere, contact_solref, new_spec
from sim_bridge.terrain import HeightField

GRAVITY_MPS2 = 9.81
WHEEL_JOINTS = 3
"""Suspension, steering and driving: degrees of freedom of each wheel, in this order."""
STEERING_FRICTION_NM = 1.0
DRY_FRICTION = {"solref_friction": [0.002, 1.0], "solimp_friction": [0.9999, 0.9999, 0.001, 0.5, 2.0]}
"""MuJoCo's own dry friction is soft: closed brakes would let the vehicle creep down a slope at 3 cm/s."""
STEERING_STOP_RAD = 0.05
"""How far beyond its range a steering axis meets its end stop."""
CHASSIS_COLOR, TYRE_COLOR, RIM_COLOR = [0.20, 0.35, 0.30, 1.0], [0.10, 0.10, 0.10, 1.0], [0.85, 0.45, 0.15, 1.0]


def build(description: Vehicle, config: VehicleSimulationConfig, terrain: HeightField | None) -> mujoco.MjModel:
    """Compile the model.

    Args:
        description: geometry and masses of the vehicle.
        config: contact parameters, suspension and friction.
        terrain: the height field, or None for an infinite plane at z = 0.
    """
    spec, solref = new_spec(config, terrain), contact_solref(config)
    chassis = spec.worldbody.add_body(name="chassis")
    chassis.add_freejoint(name="chassis")
    add_hull(chassis, "chassis", description.chassis, solref, CHASSIS_COLOR)
    for wheel in range(len(WHEELS)):
        _add_wheel(chassis, wheel, description, config, solref)
    add_imu(spec, chassis, [0.0, 0.0, description.imu_height_m])
    return spec.compile()


def _add_wheel(
    chassis: mujoco.MjsBody, wheel: int, description: Vehicle, config: VehicleSimulationConfig, solref: list[float]
) -> None:
    name, radius = WHEELS[wheel], description.wheel_radius_m
    x, y = description.wheel_positions()[wheel]
    knuckle = chassis.add_body(name=f"{name}_knuckle", pos=[x, y, radius])
    # at rest on level ground the springs carry the chassis with no travel
    load = description.chassis.mass_kg * GRAVITY_MPS2 / len(WHEELS)
    knuckle.add_joint(
        name=f"{name}_suspension",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 0, 1],
        stiffness=np.array([config.suspension_stiffness_npm, 0, 0]),
        damping=np.array([config.suspension_damping_nspm, 0, 0]),
        springref=-load / config.suspension_stiffness_npm,
        limited=True,
        range=[-config.suspension_travel_m, config.suspension_travel_m],
    )
    stop = description.steering_range_rad + STEERING_STOP_RAD
    knuckle.add_joint(
        name=f"{name}_steering",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 0, 1],
        armature=config.steering_armature_kg_m2,
        frictionloss=STEERING_FRICTION_NM,
        **DRY_FRICTION,
        limited=True,
        range=[-stop, stop],
    )
    size = 0.5 * description.wheel_width_m
    knuckle.explicitinertial = True
    knuckle.mass = description.knuckle_mass_kg
    knuckle.ipos = [0.0, 0.0, 0.0]
    knuckle.inertia = np.full(3, description.knuckle_mass_kg * size**2)
    hub = knuckle.add_body(name=f"{name}_wheel")
    hub.add_joint(
        name=f"{name}_wheel",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 1, 0],
        frictionloss=config.rolling_resistance_nm,
        **DRY_FRICTION,
    )
    hub.explicitinertial = True
    hub.mass = description.wheel_mass_kg
    hub.ipos = [0.0, 0.0, 0.0]
    across = hub.mass * (radius**2 / 4.0 + description.wheel_width_m**2 / 12.0)
    hub.inertia = [across, 0.5 * hub.mass * radius**2, across]
    # a sphere rolls on its full radius and has one point of contact; what is seen is a cylinder
    add_sphere(
        hub,
        f"{name}_tyre",
        solref,
        [0.0, 0.0, 0.0],
        radius,
        friction=[config.terrain_friction, 0.005, 0.0001],
        priority=1,
        rgba=[0, 0, 0, 0],
    )
    sideways = [-(0.5**0.5), 0.5**0.5, 0.0, 0.0]
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    add_shape(hub, name=f"{name}_rubber", type=cylinder, quat=sideways, size=[radius, size, 0], rgba=TYRE_COLOR)
    spokes = mujoco.mjtGeom.mjGEOM_BOX
    add_shape(hub, name=f"{name}_spokes", type=spokes, size=[0.8 * radius, 1.05 * size, 0.15 * radius], rgba=RIM_COLOR)
