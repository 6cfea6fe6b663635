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
from runtime.legged.friction import friction_pyramids
from runtime.legged.motion_tasks import (
    MotionTasks,
    WholeBodyConfig,
    keep_contact,
    move_trunk,
    swing_foot,
    turn_trunk,
)
from runtime.legged.relaxation import SQRT_2, RelaxationConfig, RelaxationProblem, relax, relaxation_problem
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import RigidBody, RigidBodyState, point_jacobians
from runtime.models.rotations import aligned_with_plane
from runtime.models.vectors import turned
from runtime.optimization.qp import RESIDUAL_TOLERANCE, QpSolver, interior_solution
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


class Records(NamedTuple):
    """What the law reads and writes, each as a table."""

    state: Sequence[RigidBodyState]
    body: Sequence[BodyState]
    joints: Sequence[JointState]
    gait: Sequence[Gait]
    plan: Sequence[ContactForces]
    output: Sequence[JointCommand]


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
        self._body, self._joints = body, joints
        self._model = RigidBody(description)
        gains, state = table_of(config), self._model.state.table
        records = Records(state, body.table, joints.table, gait.table, forces.table, output.table)
        self._attempt = partial(_attempt, gains, table_of(config.relaxation), table_of(description), records)
        self._write = partial(_write, gains, records)

    def command(self, now_ns: int) -> bool:
        """Write one command for every joint; false if the force QP failed and the planned forces were used."""
        body, joints = self._body, self._joints
        self._model.update(
            body.position,
            body.orientation,
            body.linear_velocity,
            body.angular_velocity,
            joints.position,
            joints.velocity,
        )
        demand = self._attempt(now_ns)
        if demand is None:
            return True
        answer = relax(self._relaxation, self._solver, demand.problem)
        self._write(demand, answer.force, answer.residual, now_ns)
        return answer.solved


@compiled
def planned_force(forces: ContactForces, now_ns: int) -> Array:
    """The plan's forces (4, 3) at a time."""
    step, last = 0, forces.knot_ns.shape[0] - 2
    while step < last and forces.knot_ns[step + 1] <= now_ns:
        step += 1
    return forces.force[12 * step : 12 * step + 12].reshape(4, 3)


@compiled
def _attempt(
    configs: Sequence[WholeBodyConfig],
    relaxations: Sequence[RelaxationConfig],
    robots: Sequence[Quadruped],
    records: Records,
    now_ns: int,
) -> WholeBodyDemand | None:
    """Write the command if no bound stands in the forces' way, as at most times; else say what there is to solve."""
    relaxation = relaxations[0]
    demand = _demand(configs[0], relaxation, robots[0], records, now_ns)
    feet, force, residual = demand.problem.planned.size // 3, demand.problem.planned, 0.0
    if feet > 0:  # with none on the ground there are no forces to find
        pyramids = friction_pyramids(feet, relaxation.friction / SQRT_2, 0.0, relaxation.force_max_n)
        inside, force, residual = interior_solution(demand.problem.hessian, demand.problem.gradient, *pyramids)
        if not inside or not residual < RESIDUAL_TOLERANCE:
            return demand
    _write(configs, records, demand, force, residual, now_ns)
    return None


@compiled
def _demand(
    config: WholeBodyConfig, relaxation: RelaxationConfig, robot: Quadruped, records: Records, now_ns: int
) -> WholeBodyDemand:
    """Stack the tasks in their order, solve the cascade, and pose the problem of the forces."""
    state, gait, plan = records.state[0], records.gait[0], records.plan[0]
    ahead_s = (now_ns - plan.stamp_ns) * 1e-9
    yaw = plan.reference_orientation[2] + plan.reference_yaw_rate * ahead_s
    plane = aligned_with_plane(yaw, records.body[0].plane_normal)
    standing, flying = np.flatnonzero(gait.contact), np.flatnonzero(gait.contact == 0)
    # a round foot rolls: what rests is the point below its centre
    lever = -robot.foot_radius_m * plane[:, 2]
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
    move_trunk(tasks, count + 3, config, state, plan, ahead_s, planned, robot.mass_kg)
    for row, foot in enumerate(flying):
        swing_foot(tasks, count + 6 + 3 * row, config, state, gait, int(foot), jacobians[foot])
    motion = prioritised_motion(tasks.jacobian, tasks.demand)

    mass, contact_jacobian = state.mass_matrix.reshape(18, 18), tasks.jacobian[:count]
    wrench = mass @ motion[:, 2].copy() + state.bias
    problem = relaxation_problem(relaxation, mass[:6, :6], wrench[:6], contact_jacobian[:, :6], planned, plane)
    return WholeBodyDemand(motion, wrench, contact_jacobian, plane, problem)


@compiled
def _write(
    configs: Sequence[WholeBodyConfig],
    records: Records,
    demand: WholeBodyDemand,
    force: Array,
    residual: float,
    now_ns: int,
) -> None:
    """Eq 41, 43 and 44: joint torques by inverse dynamics, targets and gains for the drives' own loops."""
    config, contact, output = configs[0], records.gait[0].contact, records.output[0]
    mass, torque = records.state[0].mass_matrix.reshape(18, 18), demand.wrench[6:].copy()
    output.stamp_ns, output.qp_residual = now_ns, residual
    if force.size:
        delta_b = demand.problem.change @ force - demand.problem.demand
        for joint in range(12):
            torque[joint] += mass[6 + joint, :6] @ delta_b
        for foot in range(force.size // 3):
            xyz = slice(3 * foot, 3 * foot + 3)
            torque -= turned(demand.plane, force[xyz]) @ demand.jacobian[xyz, 6:].copy()
        output.relaxation[:] = delta_b
    output.effort[:] = torque
    output.position[:] = records.joints[0].position + demand.motion[6:, 0]
    output.velocity[:] = demand.motion[6:, 1]
    for joint in range(12):
        stands = contact[joint // 3]
        output.stiffness[joint] = (
            config.stance_joint_stiffness_nm_prad if stands else config.swing_joint_stiffness_nm_prad
        )
        output.damping[joint] = config.stance_joint_damping_nms_prad if stands else config.swing_joint_damping_nms_prad
