# SPDX-License-Identifier: Apache-2.0
"""The torques of the legs' own motion against the joint rows of the whole robot's equation of motion."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.models.leg_dynamics import LegDynamics
from runtime.models.rigid_body import GRAVITY, RigidBody
from runtime.robots import load_configuration

ROBOT = load_configuration("uslgo1").quadruped
SEEDS = st.integers(0, 2**32 - 1)
DOWN = np.array([0.0, 0.0, -GRAVITY])


class Motion:
    """A random attitude and motion of trunk (in odom) and joints; without a spin, or with the gyroscope's."""

    def __init__(self, seed, spinning=True):
        rng = np.random.default_rng(seed)
        self.rotation = pin.exp3(rng.uniform(-1.7, 1.7, 3))
        self.position, self.linear = rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3)
        self.spin = rng.uniform(-3, 3, 3) * spinning
        self.acceleration = rng.uniform(-20, 20, 3)
        self.angles, self.rates = rng.uniform(-2, 2, 12), rng.uniform(-8, 8, 12)
        self.joint_acceleration = rng.uniform(-300, 300, 12)

    def model(self):
        body = RigidBody(ROBOT)
        quaternion = pin.Quaternion(self.rotation).coeffs()
        spin = self.rotation.T @ self.spin
        body.update(self.position, quaternion, self.linear, spin, self.angles, self.rates)
        return body

    def joint_rows(self, acceleration):
        """M qdd + h of the joints, the trunk's classical acceleration in odom given, its angular one nil."""
        body = self.model()
        qdd = np.concatenate((acceleration, np.zeros(3), self.joint_acceleration))
        return (body.mass_matrix @ qdd + body.bias)[6:]

    def free_torque(self, acceleration):
        """What the sensors would have it be."""
        specific_force = self.rotation.T @ (acceleration - DOWN)
        return LegDynamics(ROBOT).free_torque(
            specific_force, self.rotation.T @ self.spin, self.angles, self.rates, self.joint_acceleration
        )


@settings(max_examples=40)
@given(SEEDS)
def test_it_is_the_joint_rows_of_the_equation_of_motion(seed):
    motion = Motion(seed)
    np.testing.assert_allclose(
        motion.free_torque(motion.acceleration), motion.joint_rows(motion.acceleration), atol=1e-9
    )


@settings(max_examples=20)
@given(SEEDS)
def test_in_free_fall_only_the_legs_inertia_remains(seed):
    motion = Motion(seed, spinning=False)
    motion.rates[:] = 0.0
    mass = motion.model().mass_matrix
    np.testing.assert_allclose(motion.free_torque(DOWN), mass[6:, 6:] @ motion.joint_acceleration, atol=1e-9)


@settings(max_examples=20)
@given(SEEDS)
def test_at_rest_it_holds_the_legs_against_gravity(seed):
    motion = Motion(seed, spinning=False)
    motion.rates[:], motion.joint_acceleration[:] = 0.0, 0.0
    np.testing.assert_allclose(motion.free_torque(np.zeros(3)), motion.model().bias[6:], atol=1e-9)


@given(SEEDS)
def test_each_call_stands_for_itself(seed):
    one, other = Motion(seed), Motion(seed + 1)
    dynamics = LegDynamics(ROBOT)
    answers = [
        dynamics.free_torque(m.acceleration, m.spin, m.angles, m.rates, m.joint_acceleration) for m in (one, other, one)
    ]
    np.testing.assert_array_equal(answers[0], answers[2])
    assert np.abs(answers[0] - answers[1]).max() > 1e-3


def test_the_weight_of_a_leg_held_out_sideways_is_on_its_abad_joint():
    angles = np.tile([0.0, 0.0, 0.05], 4)
    angles[0] = np.pi / 2
    torque = LegDynamics(ROBOT).free_torque(np.array([0.0, 0.0, GRAVITY]), np.zeros(3), angles, *np.zeros((2, 12)))
    # all three links act with their levers along y: the thigh's is out by half its length and more
    masses = ROBOT.abad.mass_kg + ROBOT.thigh.mass_kg + ROBOT.shank.mass_kg
    assert 0.0 < abs(torque[0]) < masses * GRAVITY * (ROBOT.thigh_length_m + ROBOT.shank_length_m)
    body, step = RigidBody(ROBOT), 1e-6

    def potential(angle):
        moved = np.concatenate(([angle], angles[1:]))
        body.update(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3), moved, np.zeros(12))
        return ROBOT.mass_kg * GRAVITY * body.center_of_mass[2]

    slope = (potential(np.pi / 2 + step) - potential(np.pi / 2 - step)) / (2 * step)
    assert torque[0] == pytest.approx(slope, abs=1e-6)
