# SPDX-License-Identifier: Apache-2.0
"""The rigid-body model against sums over its links, finite differences and conservation laws.

That its mass matrix and bias are MuJoCo's is shown in tests/sim_bridge/test_quadruped_model.py.
"""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.models.quadruped import AXES, LEFT
from runtime.models.rigid_body import GRAVITY, RigidBody
from runtime.robots import load_configuration

ROBOT = load_configuration("uslgo1").quadruped
SEEDS = st.integers(0, 2**32 - 1)
BODIES = itertools.cycle([RigidBody(ROBOT) for _ in range(3)])
"""Enough that three states can be compared."""


class State:
    """A random state: pose of the trunk, its velocities in odom, joints."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.position = rng.uniform(-3, 3, 3)
        self.rotation = pin.exp3(rng.uniform(-1.7, 1.7, 3))
        self.linear, self.angular = rng.uniform(-2, 2, 3), rng.uniform(-3, 3, 3)
        self.angles, self.rates = rng.uniform(-2.0, 2.0, 12), rng.uniform(-8, 8, 12)

    def after(self, seconds):
        """The same motion later, at constant generalised velocity."""
        other = object.__new__(State)
        other.position = self.position + seconds * self.linear
        other.rotation = pin.exp3(seconds * self.angular) @ self.rotation
        other.linear, other.angular = self.linear, self.angular
        other.angles, other.rates = self.angles + seconds * self.rates, self.rates
        return other

    @property
    def velocity(self):
        return np.concatenate((self.linear, self.angular, self.rates))

    def model(self):
        body = next(BODIES)
        quaternion = pin.Quaternion(self.rotation).coeffs()
        spin = self.rotation.T @ self.angular
        body.update(self.position, quaternion, self.linear, spin, self.angles, self.rates)
        return body


def links(state):
    """(mass, centre of mass, inertia about it in odom) of every link, by walking down the legs."""
    trunk, rotation = ROBOT.trunk, state.rotation
    yield (
        trunk.mass_kg,
        state.position + rotation @ trunk.center(1.0),
        rotation @ np.diag(trunk.inertia_kg_m2()) @ rotation.T,
    )
    for leg in range(4):
        left, place, turn = LEFT[leg], state.position, rotation
        steps = (
            (ROBOT.abad, ROBOT.hip_positions()[leg]),
            (ROBOT.thigh, np.array([0.0, left * ROBOT.abad_length_m, 0.0])),
            (ROBOT.shank, np.array([0.0, 0.0, -ROBOT.thigh_length_m])),
        )
        for joint, (link, offset) in enumerate(steps):
            place = place + turn @ offset
            turn = turn @ pin.exp3(AXES[joint] * state.angles[3 * leg + joint])
            yield link.mass_kg, place + turn @ link.center(left), turn @ np.diag(link.inertia_kg_m2()) @ turn.T


def test_total_mass_is_the_papers():
    assert ROBOT.mass_kg == pytest.approx(12.786, abs=1e-9)
    state = State(0)
    assert sum(mass for mass, _, _ in links(state)) == pytest.approx(12.786, abs=1e-9)
    assert state.model().mass_matrix[0, 0] == pytest.approx(12.786, abs=1e-9)


@settings(max_examples=15)
@given(SEEDS)
def test_centre_of_mass_and_inertia_are_sums_over_the_links(seed):
    state = State(seed)
    body = state.model()
    parts = list(links(state))
    center = sum(mass * place for mass, place, _ in parts) / ROBOT.mass_kg
    np.testing.assert_allclose(body.center_of_mass, center, atol=1e-12)
    inertia = np.zeros((3, 3))
    for mass, place, own in parts:
        away = place - center
        inertia += own + mass * (away @ away * np.eye(3) - np.outer(away, away))
    np.testing.assert_allclose(body.inertia, inertia, atol=1e-12)


def shank_spins(state):
    """Angular velocities of the shanks in odom, (4, 3), by walking down the legs."""
    spins = []
    for leg in range(4):
        spin, turn = state.angular.copy(), state.rotation
        for joint in range(3):
            spin += turn @ AXES[joint] * state.rates[3 * leg + joint]
            turn = turn @ pin.exp3(AXES[joint] * state.angles[3 * leg + joint])
        spins.append(spin)
    return np.array(spins)


def foot_velocities(state):
    body = state.model()
    return body.point_jacobians(body.foot_position) @ state.velocity


@settings(max_examples=15)
@given(SEEDS)
def test_velocities_are_derivatives_of_positions(seed):
    state, step = State(seed), 1e-6
    body, ahead, behind = state.model(), state.after(step).model(), state.after(-step).model()
    np.testing.assert_allclose(body.velocity, state.velocity, atol=1e-14)
    np.testing.assert_allclose(
        body.com_velocity, (ahead.center_of_mass - behind.center_of_mass) / (2 * step), atol=1e-7
    )
    slope = (ahead.foot_position - behind.foot_position) / (2 * step)
    np.testing.assert_allclose(foot_velocities(state), slope, atol=1e-7)


@settings(max_examples=15)
@given(SEEDS)
def test_jacobian_of_a_point_of_the_shank(seed):
    state = State(seed)
    body = state.model()
    offsets = np.random.default_rng(seed).uniform(-0.3, 0.3, (4, 3))
    velocity = body.point_jacobians(body.foot_position + offsets) @ state.velocity
    np.testing.assert_allclose(velocity, foot_velocities(state) + np.cross(shank_spins(state), offsets), atol=1e-11)


@settings(max_examples=15)
@given(SEEDS)
def test_drift_is_the_acceleration_at_constant_generalised_velocity(seed):
    state, step = State(seed), 1e-6
    body = state.model()
    foot_drift, shank_drift = body.foot_drift.copy(), body.shank_drift.copy()
    ahead, behind = state.after(step), state.after(-step)
    slope = (foot_velocities(ahead) - foot_velocities(behind)) / (2 * step)
    np.testing.assert_allclose(foot_drift, slope, atol=2e-6)
    np.testing.assert_allclose(shank_drift, (shank_spins(ahead) - shank_spins(behind)) / (2 * step), atol=2e-6)


@settings(max_examples=15)
@given(SEEDS)
def test_mass_matrix_gives_kinetic_energy_and_momentum(seed):
    state = State(seed)
    body, velocity = state.model(), state.velocity
    mass = body.mass_matrix.copy()
    np.testing.assert_allclose(mass, mass.T, atol=1e-12)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    mass[np.arange(6, 18), np.arange(6, 18)] -= ROBOT.armature_kg_m2
    np.testing.assert_allclose((mass @ velocity)[:3], ROBOT.mass_kg * body.com_velocity, atol=1e-10)
    ahead, behind = (list(links(state.after(sign * 1e-6))) for sign in (1, -1))
    step, energy = 1e-6, 0.0
    turning = State.after(state, 0.0)
    for index, (weight, _, inertia) in enumerate(links(turning)):
        speed = (ahead[index][1] - behind[index][1]) / (2 * step)
        leg, joint = divmod(index - 1, 3)
        spin = state.angular.copy()
        if index:
            turn = state.rotation
            for number in range(joint + 1):
                spin = spin + turn @ AXES[number] * state.rates[3 * leg + number]
                turn = turn @ pin.exp3(AXES[number] * state.angles[3 * leg + number])
        energy += 0.5 * weight * speed @ speed + 0.5 * spin @ inertia @ spin
    assert 0.5 * velocity @ mass @ velocity == pytest.approx(energy, rel=1e-7)


@settings(max_examples=15)
@given(SEEDS)
def test_bias_at_rest_is_the_gradient_of_potential_energy(seed):
    state = State(seed)
    state.linear, state.angular, state.rates = np.zeros(3), np.zeros(3), np.zeros(12)
    bias, step = state.model().bias, 1e-6

    def potential(direction):
        moved = object.__new__(State)
        moved.position = state.position + step * direction[:3]
        moved.rotation = pin.exp3(step * direction[3:6]) @ state.rotation
        moved.angles = state.angles + step * direction[6:]
        return sum(mass * GRAVITY * place[2] for mass, place, _ in links(moved))

    gradient = [(potential(axis) - potential(-axis)) / (2 * step) for axis in np.eye(18)]
    np.testing.assert_allclose(bias, gradient, atol=1e-6)


@settings(max_examples=15)
@given(SEEDS)
def test_without_forces_energy_and_momentum_are_kept(seed):
    state, step = State(seed), 1e-6
    body = state.model()
    acceleration = np.linalg.solve(body.mass_matrix, -body.bias)

    def later(seconds):
        moved = state.after(seconds)
        moved.linear = state.linear + seconds * acceleration[:3]
        moved.angular = state.angular + seconds * acceleration[3:6]
        moved.rates = state.rates + seconds * acceleration[6:]
        model = moved.model()
        energy = 0.5 * moved.velocity @ model.mass_matrix @ moved.velocity
        return energy + ROBOT.mass_kg * GRAVITY * model.center_of_mass[2], model.com_velocity

    (after, faster), (before, slower) = later(step), later(-step)
    power = (after - before) / (2 * step)
    assert power == pytest.approx(0.0, abs=1e-4 * (1.0 + abs(after)))
    # rotors are not part of the links' mass, so they take no linear momentum
    np.testing.assert_allclose((faster - slower) / (2 * step), (0.0, 0.0, -GRAVITY), atol=1e-5)
