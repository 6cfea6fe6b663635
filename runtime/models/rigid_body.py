# SPDX-License-Identifier: Apache-2.0
"""The quadruped's rigid-body model: kinematics and dynamics by pinocchio, evaluated once per tick.

Generalised velocity is that of the *world-aligned* trunk frame: (linear velocity of the trunk origin in odom, angular
velocity in odom, joint velocities), so that every task of the whole-body control is written in the world frame.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from runtime.models.quadruped import AXES, FEET, LEFT, Link, Quadruped
from runtime.models.rotations import skew

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
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    return model


def _inertia(link: Link, left: float) -> pin.Inertia:
    return pin.Inertia(link.mass_kg, link.center(left), np.diag(link.inertia_kg_m2()))


class RigidBody:
    """Kinematics and dynamics at one state; `update` evaluates everything the controllers use.

    Attributes (after `update`), all in odom:
        rotation: trunk orientation, (3, 3).
        mass_matrix: (18, 18), rotor inertia included.
        bias: Coriolis, centrifugal and gravity forces, (18,).
        foot_position, foot_velocity: foot centres, (4, 3).
        foot_jacobian: of the foot centres, (4, 3, 18).
        shank_jacobian: angular, of the shanks, (4, 3, 18).
        foot_drift, shank_drift: accelerations of the foot centres and shanks at zero generalised acceleration, (4, 3).
        center_of_mass: (3,); com_velocity: (3,).
    """

    def __init__(self, description: Quadruped) -> None:
        self.description = description
        self.model = build(description)
        self.data = self.model.createData()
        self._feet = [self.model.getFrameId(f"{foot}_foot") for foot in FEET]
        self._q = pin.neutral(self.model)
        self._v = np.zeros(18)
        self._armature = np.concatenate((np.zeros(6), np.full(12, description.armature_kg_m2)))
        self._zero = np.zeros(18)
        self.mass_kg = description.mass_kg
        self.rotation = np.eye(3)
        self.mass_matrix = np.zeros((18, 18))
        self.bias = np.zeros(18)
        self.foot_position = np.zeros((4, 3))
        self.foot_velocity = np.zeros((4, 3))
        self.foot_jacobian = np.zeros((4, 3, 18))
        self.shank_jacobian = np.zeros((4, 3, 18))
        self.foot_drift = np.zeros((4, 3))
        self.shank_drift = np.zeros((4, 3))
        self.center_of_mass = np.zeros(3)
        self.com_velocity = np.zeros(3)

    def update(
        self,
        position: Array,
        orientation: Array,
        rotation: Array,
        linear_velocity: Array,
        angular_velocity: Array,
        joint_position: Array,
        joint_velocity: Array,
    ) -> None:
        """Evaluate the model.

        Args:
            position, orientation, rotation: of the trunk in odom (orientation as quaternion and, again, as matrix).
            linear_velocity, angular_velocity: of the trunk in odom.
            joint_position, joint_velocity: (12,).
        """
        q, v, data, model = self._q, self._v, self.data, self.model
        q[:3], q[3:7], q[7:] = position, orientation, joint_position
        v[:3], v[3:6], v[6:] = linear_velocity @ rotation, angular_velocity @ rotation, joint_velocity
        self.rotation = rotation
        pin.forwardKinematics(model, data, q, v, self._zero)
        pin.updateFramePlacements(model, data)
        pin.computeJointJacobians(model, data)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(model, data, q, v)
        self._world_aligned_dynamics(mass, bias, rotation)
        self.center_of_mass = pin.centerOfMass(model, data, q, v).copy()
        self.com_velocity = data.vcom[0].copy()
        for foot, frame in enumerate(self._feet):
            placement = data.oMf[frame].translation
            jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            velocity = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            drift = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            self.foot_position[foot] = placement
            self.foot_velocity[foot] = velocity.linear
            self.foot_jacobian[foot] = jacobian[:3]
            self.shank_jacobian[foot] = jacobian[3:]
            self.foot_drift[foot] = drift.linear
            self.shank_drift[foot] = drift.angular
        self._world_aligned_jacobians()

    def _world_aligned_dynamics(self, mass: Array, bias: Array, rotation: Array) -> None:
        """Change of velocity coordinates v_local = T v_world, T = diag(R^T, R^T, 1): M' = T^T M T, h' = T^T (h + M dT/dt v)."""
        local = self._v
        drift = np.cross(local[3:6], local[:3])  # d(R v)/dt = R (dv/dt + w x v): the acceleration that h leaves out
        bias = bias - mass[:, :3] @ drift
        mass[:3] = rotation @ mass[:3]
        mass[3:6] = rotation @ mass[3:6]
        mass[:, :3] = mass[:, :3] @ rotation.T
        mass[:, 3:6] = mass[:, 3:6] @ rotation.T
        bias[:3] = rotation @ bias[:3]
        bias[3:6] = rotation @ bias[3:6]
        mass.flat[:: mass.shape[0] + 1] += self._armature
        self.mass_matrix, self.bias = mass, bias

    def _world_aligned_jacobians(self) -> None:
        """Base columns in world-aligned coordinates; drift of the feet without the trunk's own classical acceleration."""
        lever = self.foot_position - self._q[:3]
        self.foot_jacobian[:, :, :3] = np.eye(3)
        self.foot_jacobian[:, :, 3:6] = -skew(lever)
        self.shank_jacobian[:, :, :3] = 0.0
        self.shank_jacobian[:, :, 3:6] = np.eye(3)
        # forwardKinematics was given zero *spatial* trunk acceleration, which is a classical acceleration w x v
        local = self._v
        self.foot_drift -= self.rotation @ np.cross(local[3:6], local[:3])

    def inertia_about_com(self) -> Array:
        """Rotational inertia of the whole robot about its centre of mass, in odom axes, (3, 3), at the last update."""
        pin.ccrba(self.model, self.data, self._q, self._v)
        return self.data.Ig.inertia.copy()
