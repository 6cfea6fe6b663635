# SPDX-License-Identifier: Apache-2.0
"""Leg kinematics in closed form against pinocchio, finite differences and themselves backwards."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.models.leg_kinematics import LegKinematics
from runtime.models.quadruped import FEET, JOINT_NAMES, LEFT
from runtime.models.rigid_body import build
from runtime.robots import load_configuration

ROBOT = load_configuration("uslgo1").quadruped
LEGS = LegKinematics(ROBOT)
SEEDS = st.integers(0, 2**32 - 1)


def angles_of(seed):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, 12)


def reachable(seed):
    """Angles as the inverse gives them: knee bent backwards, legs below the trunk."""
    rng = np.random.default_rng(seed)
    knee = rng.uniform(0.05, 2.75, 4)
    hip = rng.uniform(-1.2, 1.2, 4) - 0.5 * knee
    return np.stack((rng.uniform(-1.0, 1.0, 4), hip, knee), axis=1).ravel()


@given(SEEDS)
def test_feet_are_where_pinocchio_has_them(seed):
    model = build(ROBOT)
    data, angles = model.createData(), angles_of(seed)
    pin.framesForwardKinematics(model, data, np.concatenate((pin.neutral(model)[:7], angles)))
    feet = LEGS.forward(angles, np.zeros(12)).position
    for leg, foot in enumerate(FEET):
        place = data.oMf[model.getFrameId(f"{foot}_foot")].translation
        np.testing.assert_allclose(feet[leg], place, atol=1e-12)
        np.testing.assert_allclose(ROBOT.foot_position(leg, angles[3 * leg : 3 * leg + 3]), place, atol=1e-12)


@pytest.mark.parametrize("leg", range(4))
def test_foot_of_the_corrected_equation_1(leg):
    # y = s L1 c1 + s1 (L2 c2 + L3 c23), z = s L1 s1 - c1 (L2 c2 + L3 c23), x = L2 s2 + L3 s23
    q1, q2, q3 = 0.3, -0.8, 1.4
    s = LEFT[leg]
    reach = 0.22 * np.cos(q2) + 0.22 * np.cos(q2 + q3)
    expected = [
        (0.18 if leg < 2 else -0.18) + 0.22 * np.sin(q2) + 0.22 * np.sin(q2 + q3),
        s * 0.047 + s * 0.075 * np.cos(q1) + np.sin(q1) * reach,
        s * 0.075 * np.sin(q1) - np.cos(q1) * reach,
    ]
    np.testing.assert_allclose(ROBOT.foot_position(leg, np.array([q1, q2, q3])), expected, atol=1e-15)


def test_joints_are_in_the_order_of_their_names():
    model = build(ROBOT)
    assert tuple(model.names)[2:] == JOINT_NAMES
    assert [name.split("_")[0] for name in FEET] == ["left", "right", "left", "right"]


@given(SEEDS)
def test_velocity_and_jacobian_are_the_derivative_of_the_position(seed):
    angles, rates = angles_of(seed), np.random.default_rng(seed + 1).uniform(-5, 5, 12)
    step = 1e-6
    legs = LEGS.forward(angles, rates)
    ahead, behind = (LEGS.forward(angles + sign * step * rates, rates).position for sign in (1, -1))
    np.testing.assert_allclose(legs.velocity, (ahead - behind) / (2 * step), atol=1e-7)
    for joint in range(3):
        turn = np.tile(np.eye(3)[joint], 4) * step
        slope = (LEGS.forward(angles + turn, rates).position - LEGS.forward(angles - turn, rates).position) / (2 * step)
        np.testing.assert_allclose(legs.jacobian[:, :, joint], slope, atol=1e-8)


@given(SEEDS)
def test_shank_rate_is_that_of_the_shanks_rotation(seed):
    model = build(ROBOT)
    data, angles = model.createData(), angles_of(seed)
    rates = np.random.default_rng(seed + 1).uniform(-5, 5, 12)
    configuration = np.concatenate((pin.neutral(model)[:7], angles))
    pin.forwardKinematics(model, data, configuration, np.concatenate((np.zeros(6), rates)))
    pin.updateFramePlacements(model, data)
    shank_rate = LEGS.forward(angles, rates).shank_rate
    for leg, foot in enumerate(FEET):
        frame = model.getFrameId(f"{foot}_foot")
        spin = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).angular
        np.testing.assert_allclose(shank_rate[leg], spin, atol=1e-12)


@given(SEEDS)
def test_inverse_undoes_forward(seed):
    angles = reachable(seed)
    feet = LEGS.forward(angles, np.zeros(12)).position
    np.testing.assert_allclose(LEGS.inverse(feet), angles, atol=1e-8)


@given(SEEDS)
def test_inverse_of_any_point_is_finite_and_points_at_it(seed):
    feet = np.random.default_rng(seed).uniform(-1.5, 1.5, (4, 3))
    angles = LEGS.inverse(feet)
    assert np.isfinite(angles).all()
    reached = LEGS.forward(angles, np.zeros(12)).position
    hips = ROBOT.hip_positions()
    span = np.hypot(*(feet - hips)[:, 1:].T)
    planar = np.hypot((feet - hips)[:, 0], np.sqrt(np.maximum(span**2 - ROBOT.abad_length_m**2, 0.0)))
    inside = (planar < 0.44 - 1e-5) & (planar > 1e-3) & (span > ROBOT.abad_length_m + 1e-5)
    np.testing.assert_allclose(reached[inside], feet[inside], atol=1e-7)


def test_mirrored_angles_mirror_the_feet():
    angles = reachable(4).reshape(4, 3)
    mirrored = angles[[1, 0, 3, 2]] * (-1.0, 1.0, 1.0)
    feet = LEGS.forward(angles.ravel(), np.zeros(12)).position
    other = LEGS.forward(mirrored.ravel(), np.zeros(12)).position
    np.testing.assert_allclose(other[[1, 0, 3, 2]] * (1.0, -1.0, 1.0), feet, atol=1e-15)


@given(st.floats(0.03, 0.455))
def test_standing_angles_put_the_feet_below_the_shoulders(height):
    feet = LEGS.forward(ROBOT.standing_angles(height), np.zeros(12)).position
    np.testing.assert_allclose(feet[:, :2], ROBOT.shoulder_positions()[:, :2], atol=1e-9)
    np.testing.assert_allclose(feet[:, 2], -(height - ROBOT.foot_radius_m), atol=1e-9)


@pytest.mark.parametrize("height", [0.46, 0.6, 0.02, -0.1])
def test_heights_out_of_reach_are_refused(height):
    with pytest.raises(ValueError, match="no joint angles"):
        ROBOT.standing_angles(height)
