# SPDX-License-Identifier: Apache-2.0
"""Rotations against pinocchio's, over all of them."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.models import rotations as r

SEEDS = st.integers(0, 2**32 - 1)


def vector_of(seed, largest=math.pi - 1e-3):
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(3)
    return axis / np.linalg.norm(axis) * rng.uniform(0.0, largest)


@given(SEEDS)
def test_exponential_and_logarithm(seed):
    vector = vector_of(seed)
    matrix = r.matrix_of_quaternion(r.quaternion_of_vector(vector))
    np.testing.assert_allclose(matrix, pin.exp3(vector), atol=1e-12)
    np.testing.assert_allclose(r.rotation_vector(matrix), vector, atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-9, 1e-7, 1e-5])
def test_small_rotations_are_exact(size):
    vector = size * np.array([0.6, -0.48, 0.64])
    quaternion = r.quaternion_of_vector(vector)
    np.testing.assert_allclose(quaternion[:3], 0.5 * vector, rtol=1e-9, atol=0.0)
    np.testing.assert_allclose(r.rotation_vector(pin.exp3(vector)), vector, rtol=1e-5, atol=1e-16)


@given(SEEDS, SEEDS)
def test_products_compose(a, b):
    one, other = (r.quaternion_of_vector(vector_of(seed)) for seed in (a, b))
    product = r.quaternion_product(one, other)
    np.testing.assert_allclose(
        r.matrix_of_quaternion(product), r.matrix_of_quaternion(one) @ r.matrix_of_quaternion(other), atol=1e-12
    )
    assert product @ product == pytest.approx(1.0, abs=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_roll_pitch_yaw(roll, pitch, yaw):
    matrix = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    np.testing.assert_allclose(r.roll_pitch_yaw(matrix), (roll, pitch, yaw), atol=1e-9)
    quaternion = pin.Quaternion(matrix).coeffs()
    assert math.remainder(r.yaw_of_quaternion(quaternion) - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-100, 100))
def test_yaw_turns_x_to_y(yaw):
    np.testing.assert_allclose(r.rotation_z(yaw) @ (1, 0, 0), (math.cos(yaw), math.sin(yaw), 0), atol=1e-15)
    np.testing.assert_allclose(r.matrix_of_quaternion(r.quaternion_of_yaw(yaw)), r.rotation_z(yaw), atol=1e-14)


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction(angle):
    wrapped = r.wrapped(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.remainder(wrapped - angle, math.tau) == pytest.approx(0.0, abs=1e-9)


def normal_of(slope, direction):
    return np.array([math.sin(slope) * math.cos(direction), math.sin(slope) * math.sin(direction), math.cos(slope)])


@given(st.floats(-3.1, 3.1), st.floats(0.0, 0.6), st.floats(-3.1, 3.1))
def test_axes_of_a_plane_are_a_rotation_onto_its_normal(yaw, slope, direction):
    normal = normal_of(slope, direction)
    axes = r.aligned_with_plane(yaw, normal)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes[:, 2], normal, atol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(0.0, 0.6), st.floats(-3.1, 3.1))
def test_x_axis_in_a_plane_has_the_given_heading_seen_from_above(yaw, slope, direction):
    axes = r.aligned_with_plane(yaw, normal_of(slope, direction))
    assert math.remainder(math.atan2(axes[1, 0], axes[0, 0]) - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
