# SPDX-License-Identifier: Apache-2.0
"""Whole-body control: planned ground reactions and references in, one command per drive out (paper 000, eq 40-44)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.legged.cascade import prioritised_motion
from runtime.legged.motion_tasks import (
    MotionTasks,
    WholeBodyConfig,
    keep_contact,
    move_trunk,
    swing_foot,
    turn_trunk,
)
from runtime.legged.relaxation import Relaxation, RelaxationConfig, RelaxationProblem, relax, relaxation_problem
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import RigidBody, RigidBodyState, point_jacobians
from runtime.models.rotations import aligned_with_plane
from runtime.models.vectors import turned
from runtime.optimization.qp import QpSolver
from runtime.signals import BodyState, ContactForces, Gait, JointCommand, JointState

Array = npt.NDArray[np.float64]


class WholeBodyDemand(NamedTuple):
    """What the tasks ask of the joints and of the standing feet.

    Attributes:
        motion: position change, velocity and acceleration of the generalised coordinates, (18, 3).
        wrench: generalised forces M ddq + h, (18,).
        jacobian: of the n contact points, (3 n, 18).
        plane: columns are the tangents and the normal of the stance plane, (3, 3).
        problem: of the forces.
    """

    motion: Array
    wrench: Array
    jacobian: Array
    plane: Array
    problem: RelaxationProblem


class WholeBodyLaw:
    """The control law with strict priorities (variants FpMW and pMW).

    Args:
        description: of the robot.
        config: gains.
        solver: of the force QP.
        body, joints, gait, forces: records read.
        output: record written.
    """

    def __init__(
        self,
        description: Quadruped,
        config: WholeBodyConfig,
        solver: QpSolver,
        body: BodyState,
        joints: JointState,
        gait: Gait,
        forces: ContactForces,
        output: JointCommand,
    ) -> None:
        self._relaxation, self._solver = config.relaxation, solver
        self._body, self._joints, self._output = body, joints, output
        self._model = RigidBody(description)
        gains, state = table_of(config), self._model.state.table
        self._demand = partial(
            _demand,
            gains,
            table_of(config.relaxation),
            table_of(description),
            state,
            body.table,
            gait.table,
            forces.table,
        )
        self._write = partial(_write, gains, state, gait.table, joints.table, output.table)

    def command(self, now_ns: int) -> bool:
        """Write one command for every joint; false if the force QP failed and the planned forces were used."""
        body, joints, output = self._body, self._joints, self._output
        self._model.update(
            body.position,
            body.orientation,
            body.linear_velocity,
            body.angular_velocity,
            joints.position,
            joints.velocity,
        )
        demand = self._demand(now_ns)
        answer = AIRBORNE
        if demand.jacobian.size:
            answer = relax(self._relaxation, self._solver, demand.problem)
        output.stamp_ns, output.qp_residual = now_ns, answer.residual
        self._write(demand, answer.force)
        return answer.solved


AIRBORNE = Relaxation(np.zeros(0), True, 0.0)
"""With no foot on the ground there are no forces to find."""


@compiled
def planned_force(forces: ContactForces, now_ns: int) -> Array:
    """The plan's forces (4, 3) at a time."""
    step, last = 0, forces.knot_ns.shape[0] - 2
    while step < last and forces.knot_ns[step + 1] <= now_ns:
        step += 1
    return forces.force[12 * step : 12 * step + 12].reshape(4, 3)


@compiled
def _demand(
    configs: Sequence[WholeBodyConfig],
    relaxations: Sequence[RelaxationConfig],
    robots: Sequence[Quadruped],
    states: Sequence[RigidBodyState],
    bodies: Sequence[BodyState],
    gaits: Sequence[Gait],
    plans: Sequence[ContactForces],
    now_ns: int,
) -> WholeBodyDemand:
    """Stack the tasks in their order, solve the cascade, and pose the problem of the forces."""
    config, state, gait, plan = configs[0], states[0], gaits[0], plans[0]
    ahead_s = (now_ns - plan.stamp_ns) * 1e-9
    yaw = plan.reference_orientation[2] + plan.reference_yaw_rate * ahead_s
    plane = aligned_with_plane(yaw, bodies[0].plane_normal)
    standing, flying = np.flatnonzero(gait.contact), np.flatnonzero(gait.contact == 0)
    # a round foot rolls: what rests is the point below its centre
    lever = -robots[0].foot_radius_m * plane[:, 2]
    points, planned = state.foot_position.reshape(4, 3).copy(), np.empty((standing.size, 3))
    for row, foot in enumerate(standing):
        points[foot] += lever
        planned[row] = planned_force(plan, now_ns)[foot]
    jacobians = point_jacobians(state, points)

    count = 3 * standing.size
    tasks = MotionTasks(np.zeros((18, 18)), np.zeros((18, 3)))
    for row, foot in enumerate(standing):
        keep_contact(tasks, 3 * row, config, state, int(foot), lever, jacobians[foot])
    turn_trunk(tasks, count, config, state, plan, plane, planned, points[standing])
    move_trunk(tasks, count + 3, config, state, plan, ahead_s, planned, robots[0].mass_kg)
    for row, foot in enumerate(flying):
        swing_foot(tasks, count + 6 + 3 * row, config, state, gait, int(foot), jacobians[foot])
    motion = prioritised_motion(tasks.jacobian, tasks.demand)

    mass, contact_jacobian = state.mass_matrix.reshape(18, 18), tasks.jacobian[:count]
    wrench = mass @ motion[:, 2].copy() + state.bias
    problem = relaxation_problem(relaxations[0], mass[:6, :6], wrench[:6], contact_jacobian[:, :6], planned, plane)
    return WholeBodyDemand(motion, wrench, contact_jacobian, plane, problem)


@compiled
def _write(
    configs: Sequence[WholeBodyConfig],
    states: Sequence[RigidBodyState],
    gaits: Sequence[Gait],
    all_joints: Sequence[JointState],
    outputs: Sequence[JointCommand],
    demand: WholeBodyDemand,
    force: Array,
) -> None:
    """Eq 41, 43 and 44: joint torques by inverse dynamics, targets and gains for the drives' own loops."""
    config, contact, output = configs[0], gaits[0].contact, outputs[0]
    mass, torque = states[0].mass_matrix.reshape(18, 18), demand.wrench[6:].copy()
    if force.size:
        delta_b = demand.problem.change @ force - demand.problem.demand
        for joint in range(12):
            torque[joint] += mass[6 + joint, :6] @ delta_b
        for foot in range(force.size // 3):
            xyz = slice(3 * foot, 3 * foot + 3)
            torque -= turned(demand.plane, force[xyz]) @ demand.jacobian[xyz, 6:].copy()
        output.relaxation[:] = delta_b
    output.effort[:] = torque
    output.position[:] = all_joints[0].position + demand.motion[6:, 0]
    output.velocity[:] = demand.motion[6:, 1]
    for joint in range(12):
        stands = contact[joint // 3]
        output.stiffness[joint] = (
            config.stance_joint_stiffness_nm_prad if stands else config.swing_joint_stiffness_nm_prad
        )
        output.damping[joint] = config.stance_joint_damping_nms_prad if stands else config.swing_joint_damping_nms_prad
