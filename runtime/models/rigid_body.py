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
from runtime.models.vectors import cross, skew, skews

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


class RigidBody:
    """Kinematics and dynamics at one state; `update` evaluates everything the controllers use.

    Attributes (after `update`), all in odom:
        mass_matrix: (18, 18), rotor inertia included.
        bias: Coriolis, centrifugal and gravity forces, (18,).
        foot_position: foot centres, (4, 3).
        foot_drift, shank_drift: accelerations of the foot centres and angular ones of the shanks at zero generalised
            acceleration, (4, 3).
        center_of_mass: (3,); com_velocity: (3,).
        inertia: rotational inertia of the whole robot about its centre of mass, (3, 3).
        velocity: generalised velocity, (18,).
    """

    def __init__(self, description: Quadruped) -> None:
        self.model = build(description)
        self.data = self.model.createData()
        self.mass_kg = description.mass_kg
        self._feet = [self.model.getFrameId(f"{foot}_foot") for foot in FEET]
        self._q = pin.neutral(self.model)
        self._v = np.zeros(18)
        self._zero = np.zeros(18)
        self._to_local = np.eye(18)
        self._jacobians = np.zeros((4, 3, 18))
        self._jacobians[:, :, :3] = np.eye(3)
        self._trunk_columns = self._jacobians[:, :, 3:6]
        self._leg_blocks = [self._jacobians[foot, :, 6 + 3 * foot : 9 + 3 * foot] for foot in range(4)]
        self.velocity = np.zeros(18)
        self.mass_matrix = np.zeros((18, 18))
        self.bias = np.zeros(18)
        self.foot_position = np.zeros((4, 3))
        self.foot_drift = np.zeros((4, 3))
        self.shank_drift = np.zeros((4, 3))
        self.center_of_mass = np.zeros(3)
        self.com_velocity = np.zeros(3)
        self.inertia = np.eye(3)

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
            position: of the trunk in odom, m.
            orientation: of the trunk, (x, y, z, w).
            rotation: the same as a matrix, (3, 3).
            linear_velocity: of the trunk in odom, m/s.
            angular_velocity: of the trunk in odom, rad/s.
            joint_position: (12,), rad.
            joint_velocity: (12,), rad/s.
        """
        q, v, data, model = self._q, self._v, self.data, self.model
        q[:3], q[3:7], q[7:] = position, orientation, joint_position
        self.velocity[:3], self.velocity[3:6], self.velocity[6:] = linear_velocity, angular_velocity, joint_velocity
        to_local = self._to_local
        to_local[:3, :3] = to_local[3:6, 3:6] = rotation.T
        np.dot(to_local, self.velocity, out=v)
        pin.computeAllTerms(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, self._zero)
        pin.updateFramePlacements(model, data)
        # zero acceleration in world-aligned coordinates is a linear acceleration -w x v in the trunk's own
        drift = cross(v[3:6], v[:3])
        mass = data.M
        self.mass_matrix = to_local.T @ mass @ to_local
        self.bias = to_local.T @ (data.nle - mass[:, :3] @ drift)
        self.center_of_mass, self.com_velocity = data.com[0].copy(), data.vcom[0].copy()
        self.inertia = data.Ig.inertia
        # forwardKinematics was given zero *spatial* trunk acceleration, which is a classical acceleration w x v
        base_drift = rotation @ drift
        moved = [pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in self._feet]
        self.foot_position = np.array([data.oMf[frame].translation for frame in self._feet])
        self.foot_drift = np.array([motion.linear for motion in moved]) - base_drift
        self.shank_drift = np.array([motion.angular for motion in moved])

    def point_jacobians(self, points: Array) -> Array:
        """Jacobians (4, 3, 18) of four points (4, 3) in odom, each fixed to the shank of its leg.

        The array is overwritten by the next call.
        """
        columns = self.data.J[:, 6:].reshape(2, 3, 4, 3)
        arms = skews(points)
        self._trunk_columns[...] = skew(self._q[:3]) - arms
        for foot, block in enumerate(self._leg_blocks):
            block[...] = columns[0, :, foot] - arms[foot] @ columns[1, :, foot]
        return self._jacobians
