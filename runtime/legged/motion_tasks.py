# SPDX-License-Identifier: Apache-2.0
"""The tasks of the whole-body control (paper 000, Table 3): each fills its rows of the stacked Jacobian and demand."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.legged.relaxation import RelaxationConfig
from runtime.models.rigid_body import GRAVITY, RigidBodyState
from runtime.models.rotations import rotation_vector
from runtime.models.vectors import cross, solve_three, total_moment
from runtime.signals import ContactForces, Gait

Array = npt.NDArray[np.float64]
Gain = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
JointStiffness = Annotated[float, msgspec.Meta(ge=0.0, le=500.0)]
JointDamping = Annotated[float, msgspec.Meta(ge=0.0, le=5.0)]


class WholeBodyConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Gains of the whole-body control.

    Attributes:
        relaxation: weights of the force QP.
        contact_damping: K_d of the contact points, 1/s: how soon a foot that slides comes to rest.
        rotation_stiffness, rotation_damping: K_p, K_d of the body rotation task, 1/s^2 and 1/s.
        translation_stiffness, translation_damping: the same of the body translation task.
        swing_stiffness, swing_damping: the same of the swing foot task.
        stance_joint_stiffness_nm_prad, stance_joint_damping_nms_prad: k_p, k_d of eq 44 for standing legs.
        swing_joint_stiffness_nm_prad, swing_joint_damping_nms_prad: the same for legs in the air.
    """

    relaxation: RelaxationConfig = RelaxationConfig()
    contact_damping: Gain = 100.0
    rotation_stiffness: Gain = 100.0
    rotation_damping: Gain = 20.0
    translation_stiffness: Gain = 50.0
    translation_damping: Gain = 10.0
    swing_stiffness: Gain = 400.0
    swing_damping: Gain = 40.0
    stance_joint_stiffness_nm_prad: JointStiffness = 10.0
    stance_joint_damping_nms_prad: JointDamping = 0.5
    swing_joint_stiffness_nm_prad: JointStiffness = 30.0
    swing_joint_damping_nms_prad: JointDamping = 0.8


class MotionTasks(NamedTuple):
    """Tasks on the generalised coordinates, those of the highest priority first.

    Attributes:
        jacobian: (18, 18).
        demand: columns are the position error, the velocity and the acceleration less the drift, (18, 3).
    """

    jacobian: Array
    demand: Array


@compiled
def keep_contact(
    tasks: MotionTasks,
    row: int,
    config: WholeBodyConfig,
    state: RigidBodyState,
    foot: int,
    lever: Array,
    jacobian: Array,
) -> None:
    """Priority 0: the contact point, off the foot's centre by `lever`, rests, or comes to rest if it slides."""
    xyz, rows = slice(3 * foot, 3 * foot + 3), slice(row, row + 3)
    tasks.jacobian[rows] = jacobian
    tasks.demand[rows, 2] = -(state.foot_drift[xyz] + cross(state.shank_drift[xyz], lever))
    tasks.demand[rows, 2] -= config.contact_damping * (jacobian @ state.velocity)


@compiled
def turn_trunk(
    tasks: MotionTasks,
    row: int,
    config: WholeBodyConfig,
    state: RigidBodyState,
    plan: ContactForces,
    plane: Array,
    planned: Array,
    points: Array,
) -> None:
    """Priority 1: the trunk's orientation; the feed-forward is the planned forces' angular acceleration."""
    error = rotation_vector(plane @ state.rotation.reshape(3, 3).T)
    rate = np.array([0.0, 0.0, plan.reference_yaw_rate])
    moment = total_moment(points - state.center_of_mass, planned)
    acceleration = solve_three(state.inertia.reshape(3, 3), moment)
    acceleration += config.rotation_stiffness * error + config.rotation_damping * (rate - state.velocity[3:6])
    for axis in range(3):
        tasks.jacobian[row + axis, 3 + axis] = 1.0
        tasks.demand[row + axis, 0], tasks.demand[row + axis, 1] = error[axis], rate[axis]
        tasks.demand[row + axis, 2] = acceleration[axis]


@compiled
def move_trunk(
    tasks: MotionTasks,
    row: int,
    config: WholeBodyConfig,
    state: RigidBodyState,
    plan: ContactForces,
    ahead_s: float,
    planned: Array,
    mass_kg: float,
) -> None:
    """Priority 2: the centre of mass; the feed-forward is the planned forces' acceleration."""
    velocity = plan.reference_velocity
    error = plan.reference_position + velocity * ahead_s - state.center_of_mass
    acceleration = planned.sum(axis=0) / mass_kg
    acceleration[2] -= GRAVITY
    acceleration += config.translation_stiffness * error
    acceleration += config.translation_damping * (velocity - state.com_velocity)
    for axis in range(3):
        tasks.jacobian[row + axis, axis] = 1.0
        tasks.demand[row + axis, 0], tasks.demand[row + axis, 1] = error[axis], velocity[axis]
        tasks.demand[row + axis, 2] = acceleration[axis]


@compiled
def swing_foot(
    tasks: MotionTasks, row: int, config: WholeBodyConfig, state: RigidBodyState, gait: Gait, foot: int, jacobian: Array
) -> None:
    """Priority 3: a foot in the air follows its reference."""
    xyz, rows = slice(3 * foot, 3 * foot + 3), slice(row, row + 3)
    error = gait.swing_position[xyz] - state.foot_position[xyz]
    slip = gait.swing_velocity[xyz] - jacobian @ state.velocity
    tasks.jacobian[rows] = jacobian
    tasks.demand[rows, 0], tasks.demand[rows, 1] = error, gait.swing_velocity[xyz]
    tasks.demand[rows, 2] = gait.swing_acceleration[xyz] - state.foot_drift[xyz]
    tasks.demand[rows, 2] += config.swing_stiffness * error + config.swing_damping * slip
