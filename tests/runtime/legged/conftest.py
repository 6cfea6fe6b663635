# SPDX-License-Identifier: Apache-2.0
"""USLGO1 standing squarely on a plane: every record that the legged tasks read."""

import numpy as np
import pinocchio as pin
import pytest

from runtime import signals
from runtime.models.leg_kinematics import LegKinematics
from runtime.models.rigid_body import GRAVITY, RigidBody
from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import sizes

CONFIG = load_configuration("uslgo1")
SIZES = sizes(CONFIG)
HEIGHT_M = CONFIG.posture.height_m


class Bench:
    """The records, at one instant at which the robot stands still at a yaw."""

    def __init__(self, yaw=0.0, velocity=(0.0, 0.0, 0.0)):
        self.config, self.robot = CONFIG, CONFIG.quadruped
        self.body = signals.BodyState("/body", SIZES)
        self.joints = signals.JointState("/joints", SIZES)
        self.gait = signals.Gait("/gait", SIZES)
        self.command = signals.BodyCommand("/command")
        self.forces = signals.ContactForces("/forces", SIZES)
        self.output = signals.JointCommand("/output", SIZES)
        self.safety = signals.SafetyStatus("/safety")
        self.posture = signals.Posture("/posture", SIZES)
        self.operator = signals.OperatorRequest("/operator")
        self.rotation = pin.rpy.rpyToMatrix(0.0, 0.0, yaw)
        self.joints.position = self.robot.standing_angles(HEIGHT_M)
        body = self.body
        body.stamp_ns = 1
        body.position = (0.4, -0.3, HEIGHT_M)
        body.orientation = pin.Quaternion(self.rotation).coeffs()
        body.linear_velocity = velocity
        body.plane_normal, body.height, body.contact = (0.0, 0.0, 1.0), HEIGHT_M, True
        feet = LegKinematics(self.robot).forward(self.joints.position, np.zeros(12)).position
        self.feet = body.position + feet @ self.rotation.T
        body.foot_position = self.feet.ravel()
        self.gait.balancing = True
        self.gait.stance, self.gait.contact = True, True
        self.gait.foothold = self.feet.ravel()
        self.safety.mode, self.posture.stance = signals.Mode.ACTIVE, signals.Stance.STANDING

    def model(self):
        """The rigid-body model at this instant."""
        body = RigidBody(self.robot)
        state = self.body
        body.update(
            state.position,
            state.orientation,
            state.linear_velocity,
            state.angular_velocity,
            self.joints.position,
            self.joints.velocity,
        )
        return body

    def balanced(self, now_ns):
        """A plan that carries the weight where the robot is; returns the forces (4, 3)."""
        model, forces = self.model(), self.forces
        arms = self.feet - (0.0, 0.0, self.robot.foot_radius_m) - model.center_of_mass
        rows = np.array([np.ones(4), arms[:, 0], arms[:, 1]])
        vertical = np.linalg.pinv(rows) @ (self.robot.mass_kg * GRAVITY, 0.0, 0.0)
        share = np.outer(vertical, (0.0, 0.0, 1.0))
        steps = CONFIG.mpc.steps
        forces.stamp_ns, forces.knot_ns = now_ns, now_ns + np.arange(steps + 1) * 40_000_000
        forces.stance, forces.force = True, np.tile(share.ravel(), steps)
        forces.reference_position = model.center_of_mass
        forces.reference_orientation = (0.0, 0.0, np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))
        return share


@pytest.fixture
def bench():
    """Makes a standing robot."""
    return Bench
