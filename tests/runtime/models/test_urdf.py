# SPDX-License-Identifier: Apache-2.0
"""The robot as URDF is the robot as the controllers see it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from runtime.models.quadruped import FEET, JOINT_NAMES
from runtime.models.rigid_body import build
from runtime.robots import description, load_configuration


@pytest.fixture(scope="module")
def config():
    return load_configuration("uslgo1")


@pytest.fixture(scope="module")
def parsed(config):
    return pin.buildModelFromXML(description(config), pin.JointModelFreeFlyer())


def in_order(model, values):
    """A joint array in the order of another model's joints."""
    q = pin.neutral(model)
    for name, value in zip(JOINT_NAMES, values, strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = value
    return q


def test_masses_and_inertias_are_those_of_the_rigid_body_model(config, parsed):
    own, angles = build(config.quadruped), np.linspace(-0.9, 1.1, 12)
    matrices = []
    for model in (own, parsed):
        model.armature = np.zeros(18)
        q = in_order(model, angles)
        mass = pin.crba(model, model.createData(), q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        order = [*range(6), *(model.joints[model.getJointId(name)].idx_v for name in JOINT_NAMES)]
        matrices.append(mass[np.ix_(order, order)])
    np.testing.assert_allclose(matrices[1], matrices[0], atol=1e-12)


def test_feet_are_where_they_are(config, parsed):
    angles = np.linspace(-0.9, 1.1, 12)
    data = parsed.createData()
    pin.framesForwardKinematics(parsed, data, in_order(parsed, angles))
    for leg, foot in enumerate(FEET):
        place = data.oMf[parsed.getFrameId(f"{foot}_foot")].translation
        np.testing.assert_allclose(
            place, config.quadruped.foot_position(leg, angles[3 * leg : 3 * leg + 3]), atol=1e-12
        )


def test_limits_are_the_safety_filter_s(config, parsed):
    safety = config.safety
    q = [parsed.joints[parsed.getJointId(name)].idx_q for name in JOINT_NAMES]
    np.testing.assert_allclose(parsed.lowerPositionLimit[q][:3], safety.position_min_rad)
    np.testing.assert_allclose(
        parsed.upperPositionLimit[q][3:6], [-safety.position_min_rad[0], *safety.position_max_rad[1:]]
    )
    assert set(parsed.effortLimit[6:]) == {safety.effort_max_nm}
