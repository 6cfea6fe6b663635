# SPDX-License-Identifier: Apache-2.0
"""The quadruped's rigid-body model, evaluated once per tick: dynamics by pinocchio, the feet in closed form.

Generalised velocity is that of the *world-aligned* trunk frame: (linear velocity of the trunk origin in odom, angular
velocity in odom, joint velocities), so that every task of the whole-body control is written in the world frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from runtime.compiled import compiled, table_of
from runtime.models.leg_kinematics import LegState, leg_drift, leg_state
from runtime.models.quadruped import AXES, FEET, LEFT, Link, Quadruped
from runtime.models.rotations import matrix_of_quaternion
from runtime.models.vectors import cross, dot, skew, turned
from runtime.records import Record, float64_array

Array = npt.NDArray[np.float64]
GRAVITY = 9.81


def build(description: Quadruped) -> pin.Model:
    """The pinocchio model of a quadruped, joints and feet in the order of `quadruped`."""
    model = pin.Model()
    trunk = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "trunk")
    model.appendBodyToJoint(trunk, _inertia(description.trunk, 1.0), pin.SE3.Identity())
    links = (description.abad, description.thigh, description.shank)
    for leg, foot in enumerate(FEET):
        offsets = (
            description.hip_positions()[leg],
            np.array([0.0, LEFT[leg] * description.abad_length_m, 0.0]),
            np.array([0.0, 0.0, -description.thigh_length_m]),
        )
        parent = trunk
        for name, axis, offset, link in zip(("abad", "hip", "knee"), AXES, offsets, links, strict=True):
            joint = pin.JointModelRevoluteUnaligned(axis)
            parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), offset), f"{foot}_{name}")
            model.appendBodyToJoint(parent, _inertia(link, LEFT[leg]), pin.SE3.Identity())
        placement = pin.SE3(np.eye(3), np.array([0.0, 0.0, -description.shank_length_m]))
        model.addFrame(pin.Frame(f"{foot}_foot", parent, 0, placement, pin.FrameType.OP_FRAME))
    model.armature = np.concatenate((np.zeros(6), np.full(12, description.armature_kg_m2)))
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    return model


def _inertia(link: Link, left: float) -> pin.Inertia:
    return pin.Inertia(link.mass_kg, link.center(left), np.diag(link.inertia_kg_m2()))


class RigidBodyState(Record):
    """The model evaluated at one state, in odom; matrices row by row.

    The bias is that of Coriolis, centrifugal and gravity forces; the drifts are accelerations at zero generalised
    acceleration. `foot_jacobian` and `joint_axis` are (foot, axis, joint): by the joints of the foot's own leg.
    """

    position = float64_array(3, "m", "of the trunk")
    rotation = float64_array(9, "", "of the trunk")
    velocity = float64_array(18, "m/s, rad/s", "generalised")
    mass_matrix = float64_array(18 * 18, "", "rotor inertia included")
    bias = float64_array(18)
    center_of_mass = float64_array(3, "m")
    com_velocity = float64_array(3, "m/s")
    inertia = float64_array(9, "kg.m^2", "of the whole robot about its centre of mass")
    foot_position = float64_array(12, "m", "foot centres")
    foot_drift = float64_array(12, "m/s^2", "of the foot centres")
    shank_drift = float64_array(12, "rad/s^2", "of the shanks")
    foot_jacobian = float64_array(36)
    joint_axis = float64_array(36)


class RigidBody:
    """Kinematics and dynamics at one state; `update` evaluates everything the controllers use.

    Attributes:
        state: what `update` found, for compiled kernels; the others are views of it.
        mass_kg: of the robot.
        mass_matrix: (18, 18).
        bias, velocity: (18,).
        foot_position, foot_drift, shank_drift: (4, 3).
        center_of_mass, com_velocity: (3,).
        inertia, rotation: (3, 3).
    """

    def __init__(self, description: Quadruped) -> None:
        self.mass_kg = description.mass_kg
        self.state: RigidBodyState = RigidBodyState("/rigid_body")
        self._robot = table_of(description)
        self._model = build(description)
        self._data = self._model.createData()
        self._q, self._v = pin.neutral(self._model), np.zeros(18)
        # these views stay where they are; looking one up costs more than a copy of it
        self._mass, self._effects = self._data.M, self._data.nle
        self._center, self._center_velocity = self._data.com[0], self._data.vcom[0]
        state = self.state
        self.mass_matrix, self.bias, self.velocity = state.mass_matrix.reshape(18, 18), state.bias, state.velocity
        self.foot_position, self.foot_drift = state.foot_position.reshape(4, 3), state.foot_drift.reshape(4, 3)
        self.shank_drift = state.shank_drift.reshape(4, 3)
        self.center_of_mass, self.com_velocity = state.center_of_mass, state.com_velocity
        self.inertia, self.rotation = state.inertia.reshape(3, 3), state.rotation.reshape(3, 3)

    def update(
        self,
        position: Array,
        orientation: Array,
        linear_velocity: Array,
        angular_velocity: Array,
        joint_position: Array,
        joint_velocity: Array,
    ) -> None:
        """Evaluate the model.

        Args:
            position: of the trunk in odom, m.
            orientation: of the trunk, (x, y, z, w).
            linear_velocity: of the trunk in odom, m/s.
            angular_velocity: of the trunk in base, rad/s.
            joint_position: (12,), rad.
            joint_velocity: (12,), rad/s.
        """
        trunk = position, orientation, linear_velocity, angular_velocity
        _configure(*trunk, joint_position, joint_velocity, self._q, self._v, self.state.table)
        pin.computeAllTerms(self._model, self._data, self._q, self._v)
        _evaluate(
            self._robot,
            joint_position,
            joint_velocity,
            self._v,
            self._mass,
            self._effects,
            self._center,
            self._center_velocity,
            self._data.Ig.inertia,
            self.state.table,
        )

    def point_jacobians(self, points: Array) -> Array:
        """Jacobians (4, 3, 18) of four points (4, 3) in odom, each fixed to the shank of its leg."""
        return point_jacobians(self.state.table[0], points)


@compiled
def _configure(
    position: Array,
    orientation: Array,
    linear_velocity: Array,
    angular_velocity: Array,
    joint_position: Array,
    joint_velocity: Array,
    q: Array,
    v: Array,
    states: Sequence[RigidBodyState],
) -> None:
    """Write pinocchio's configuration and velocity, whose trunk twist is in the trunk's own axes."""
    state, rotation = states[0], matrix_of_quaternion(orientation)
    q[:3], q[3:7], q[7:] = position, orientation, joint_position
    v[:3], v[3:6], v[6:] = turned(rotation.T, linear_velocity), angular_velocity, joint_velocity
    state.position[:] = position
    state.rotation[:] = rotation.ravel()
    state.velocity[:3] = linear_velocity
    state.velocity[3:6] = turned(rotation, angular_velocity)
    state.velocity[6:] = joint_velocity


@compiled
def _evaluate(
    robots: Sequence[Quadruped],
    angles: Array,
    rates: Array,
    local_velocity: Array,
    mass: Array,
    effects: Array,
    center: Array,
    center_velocity: Array,
    inertia: Array,
    states: Sequence[RigidBodyState],
) -> None:
    """Complete the state from pinocchio's results."""
    state = states[0]
    _world_aligned(state, local_velocity, mass, effects)
    _place_feet(state, leg_state(robots[0], angles, rates), leg_drift(robots[0], angles, rates), angles)
    state.center_of_mass[:], state.com_velocity[:] = center, center_velocity
    for axis in range(3):
        state.inertia[3 * axis : 3 * axis + 3] = inertia[axis]


@compiled
def _world_aligned(state: RigidBodyState, local_velocity: Array, mass: Array, effects: Array) -> None:
    """Mass matrix and bias forces for the world-aligned velocity, from those for the trunk's own axes."""
    rotation, matrix = state.rotation.reshape(3, 3), state.mass_matrix.reshape(18, 18)
    # zero acceleration in world-aligned coordinates is a linear acceleration -w x v in the trunk's own
    drift = cross(local_velocity[3:6], local_velocity[:3])
    for row in range(18):
        state.bias[row] = effects[row] - dot(mass[row, :3], drift)
        matrix[row, :3], matrix[row, 3:6] = turned(rotation, mass[row, :3]), turned(rotation, mass[row, 3:6])
        matrix[row, 6:] = mass[row, 6:]
    for begin in (0, 3):
        rows = slice(begin, begin + 3)
        state.bias[rows] = turned(rotation, state.bias[rows])
        for column in range(18):
            matrix[rows, column] = turned(rotation, matrix[rows, column])


@compiled
def _place_feet(state: RigidBodyState, legs: LegState, drifts: tuple[Array, Array], angles: Array) -> None:
    """The feet in odom, from those in the trunk frame."""
    rotation, spin = state.rotation.reshape(3, 3), state.velocity[3:6]
    jacobian, axes = state.foot_jacobian.reshape(4, 3, 3), state.joint_axis.reshape(4, 3, 3)
    for leg in range(4):
        xyz = slice(3 * leg, 3 * leg + 3)
        arm, relative = turned(rotation, legs.position[leg]), turned(rotation, legs.velocity[leg])
        state.foot_position[xyz] = state.position + arm
        coriolis = cross(spin, cross(spin, arm)) + 2.0 * cross(spin, relative)
        state.foot_drift[xyz] = turned(rotation, drifts[0][leg]) + coriolis
        shank_rate = turned(rotation, legs.shank_rate[leg])
        state.shank_drift[xyz] = turned(rotation, drifts[1][leg]) + cross(spin, shank_rate)
        for joint in range(3):
            jacobian[leg, :, joint] = turned(rotation, legs.jacobian[leg, :, joint])
        axes[leg, :, 0] = rotation[:, 0]
        pitch = -math.cos(angles[3 * leg]) * rotation[:, 1] - math.sin(angles[3 * leg]) * rotation[:, 2]
        axes[leg, :, 1] = pitch
        axes[leg, :, 2] = pitch


@compiled
def point_jacobians(state: RigidBodyState, points: Array) -> Array:
    """Jacobians (4, 3, 18) of four points (4, 3) in odom, each fixed to the shank of its leg."""
    columns, axes = state.foot_jacobian.reshape(4, 3, 3), state.joint_axis.reshape(4, 3, 3)
    jacobians = np.zeros((4, 3, 18))
    for leg in range(4):
        block, offset = jacobians[leg], points[leg] - state.foot_position[3 * leg : 3 * leg + 3]
        block[0, 0] = block[1, 1] = block[2, 2] = 1.0
        block[:, 3:6] = -skew(points[leg] - state.position)
        for joint in range(3):
            block[:, 6 + 3 * leg + joint] = columns[leg, :, joint] + cross(axes[leg, :, joint], offset)
    return jacobians
