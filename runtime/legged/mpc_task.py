# SPDX-License-Identifier: Apache-2.0
"""The MPC as a task: from the present estimate, command and gait to the ground reactions of one gait cycle."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.legged.contact_plan import contact_points, nominal_centers, stance_schedule
from runtime.legged.gait import GaitConfig, knots
from runtime.legged.mpc import Horizon, MpcConfig, TrunkMpc
from runtime.legged.posture import PostureConfig
from runtime.legged.reference import Demand, Ground, advanced, reference_states, velocity_along
from runtime.legged.whole_body import planned_force
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY, RigidBody, RigidBodyState
from runtime.models.rotations import aligned_with_plane, roll_pitch_yaw, rotation_z, wrapped
from runtime.models.vectors import solve_three, total_moment, turned
from runtime.optimization.qp import QpSolver
from runtime.records import Record, boolean, float64, float64_array, int64, uint32
from runtime.signals import BodyCommand, BodyState, ContactForces, Gait, JointState
from runtime.tasks import Task

Array = npt.NDArray[np.float64]


LONGEST_STEP = 5.0
"""Periods; the reference does not move on for a longer gap between two plans."""


class MpcMemory(Record):
    """What the MPC must remember."""

    started = boolean()
    step_ns = int64("ns", "when the last plan was begun")
    reference_xy = float64_array(2, "m", "horizontal reference of the centre of mass")
    reference_yaw = float64("rad")
    failures = uint32()


class MpcTask(Task):
    """Plans ground reactions at a fixed rate.

    Args:
        description: of the robot.
        config, gait, posture: parameters.
        solver: of the quadratic program.
        latency_ns: the budget after which the plan takes effect; the state is predicted over it.
        period_ns: of this task.
        body, joints, command, gait_state: records read.
        output: record written.
    """

    name = "mpc"

    def __init__(
        self,
        description: Quadruped,
        config: MpcConfig,
        gait: GaitConfig,
        posture: PostureConfig,
        solver: QpSolver,
        latency_ns: int,
        period_ns: int,
        body: BodyState,
        joints: JointState,
        command: BodyCommand,
        gait_state: Gait,
        output: ContactForces,
    ) -> None:
        self._latency_ns = latency_ns
        self._body, self._joints, self._gait_state, self._output = body, joints, gait_state, output
        self._mpc = TrunkMpc(config, solver)
        self._model = RigidBody(description)
        self.reads, self.writes = (body, joints, command, gait_state), (output,)
        self.state: MpcMemory = MpcMemory("/ugv/state/mpc", output.sizes)
        self._horizon = partial(
            _horizon,
            table_of(config),
            table_of(gait),
            table_of(description),
            self._model.state.table,
            body.table,
            command.table,
            gait_state.table,
            output.table,
            self.state.table,
            description.shoulder_positions(),
            posture.height_m,
            latency_ns,
            period_ns * 1e-9,
        )

    def step(self, now_ns: int) -> None:
        """One plan; see `Task`. If it cannot be found, the last good one stays and the failure is counted."""
        memory, output, body = self.state, self._output, self._body
        if body.stamp_ns == 0 or not self._gait_state.balancing:
            memory.started = False
            return
        self._model.update(
            body.position,
            body.orientation,
            body.linear_velocity,
            body.angular_velocity,
            self._joints.position,
            self._joints.velocity,
        )
        boundaries, horizon = self._horizon(now_ns + self._latency_ns)
        if not np.isfinite(horizon.reference).all():
            memory.started = False  # the reference starts anew from the next finite state
        plan = self._mpc.plan(horizon)
        if plan.solved:
            output.stamp_ns, output.knot_ns = boundaries[0], boundaries
            output.stance, output.force, output.cost = horizon.stance.ravel(), plan.force.ravel(), plan.cost
            self._publish_reference(horizon.reference[0])
        else:
            memory.failures += 1
        output.residual, output.iterations, output.failures = plan.residual, plan.iterations, memory.failures

    def _publish_reference(self, first: Array) -> None:
        """What the whole-body control holds the trunk to until the next plan."""
        output, memory = self._output, self.state
        output.reference_position = (*memory.reference_xy, first[5])
        output.reference_velocity = first[9:12]
        output.reference_orientation = (first[0], first[1], memory.reference_yaw)
        output.reference_yaw_rate = first[8]


@compiled
def _horizon(
    configs: Sequence[MpcConfig],
    gaits: Sequence[GaitConfig],
    robots: Sequence[Quadruped],
    models: Sequence[RigidBodyState],
    bodies: Sequence[BodyState],
    commands: Sequence[BodyCommand],
    gait_states: Sequence[Gait],
    plans: Sequence[ContactForces],
    memories: Sequence[MpcMemory],
    shoulders: Array,
    height_m: float,
    latency_ns: int,
    period_s: float,
    begin_ns: int,
) -> tuple[npt.NDArray[np.int64], Horizon]:
    """The boundaries of the steps, and everything that the plan is made for."""
    config, gait, robot, model, body = configs[0], gaits[0], robots[0], models[0], bodies[0]
    gait_state, memory, normal = gait_states[0], memories[0], bodies[0].plane_normal
    boundaries = knots(gait, gait_state.cycle_start_ns, begin_ns, config.steps)
    durations = np.diff(boundaries) * 1e-9
    state = _predicted_state(robot.mass_kg, model, body, gait_state, plans[0], latency_ns * 1e-9)
    elapsed_s = period_s
    if memory.started:
        elapsed_s = min((begin_ns - latency_ns - memory.step_ns) * 1e-9, LONGEST_STEP * period_s)
    memory.step_ns = begin_ns - latency_ns
    demand = Demand(0.0, 0.0, 0.0)
    if gait_state.walking:
        command = commands[0]
        demand = Demand(command.velocity[0], command.velocity[1], command.yaw_rate)
    _advance_reference(config, memory, state, demand, normal, elapsed_s)
    reference = _reference(memory, model, body, demand, height_m, durations)
    stance = np.ones((config.steps, 4), dtype=np.bool_)
    if gait_state.walking:
        stance = stance_schedule(gait, gait_state.cycle_start_ns, boundaries)
    feet = contact_points(stance, gait_state.foothold.reshape(4, 3), shoulders, reference, normal, gait.stance_s)
    center = nominal_centers(state[3:6], reference, durations)
    lever = np.empty(feet.shape)
    for step in range(config.steps):
        lever[step] = feet[step] - (robot.foot_radius_m * normal + center[step])
    plane = aligned_with_plane(memory.reference_yaw, normal)
    heading = rotation_z(state[2])
    inertia = heading.T @ model.inertia.reshape(3, 3) @ heading
    return boundaries, Horizon(state, reference, durations, stance, lever, plane, inertia, robot.mass_kg)


@compiled
def _predicted_state(
    mass_kg: float, model: RigidBodyState, body: BodyState, gait_state: Gait, plan: ContactForces, seconds: float
) -> Array:
    """The state when the plan takes effect, under the forces of the plan that is in effect now."""
    rotation, spin, contact = model.rotation.reshape(3, 3), model.velocity[3:6], gait_state.contact
    force = planned_force(plan, body.stamp_ns).copy()
    for foot in range(4):
        if not contact[foot]:
            force[foot] = 0.0
    if not force.any():
        force[:, 2] = contact * (mass_kg * GRAVITY / max(1, contact.sum()))
    acceleration = force.sum(axis=0) / mass_kg
    acceleration[2] -= GRAVITY
    moment = total_moment(body.foot_position.reshape(4, 3) - model.center_of_mass, force)
    angular = solve_three(model.inertia.reshape(3, 3), moment)
    roll, pitch, yaw = roll_pitch_yaw(rotation)
    state = np.empty(12)
    state[:3] = turned(rotation_z(yaw).T, seconds * spin + 0.5 * seconds**2 * angular)
    state[0], state[1], state[2] = state[0] + roll, state[1] + pitch, state[2] + yaw
    state[3:6] = model.center_of_mass + seconds * model.com_velocity + 0.5 * seconds**2 * acceleration
    state[6:9] = spin + seconds * angular
    state[9:] = model.com_velocity + seconds * acceleration
    return state


@compiled
def _advance_reference(
    config: MpcConfig, memory: MpcMemory, state: Array, demand: Demand, normal: Array, elapsed_s: float
) -> None:
    """Move the reference on by the time since the last plan, not too far from the robot."""
    if not memory.started:
        memory.started = True
        memory.reference_xy[:], memory.reference_yaw = state[3:5], state[2]
    ahead = wrapped(memory.reference_yaw + demand.yaw_rate * elapsed_s - state[2])
    memory.reference_yaw = state[2] + max(-config.heading_clamp_rad, min(config.heading_clamp_rad, ahead))
    velocity = velocity_along(aligned_with_plane(memory.reference_yaw, normal), demand)
    memory.reference_xy[:] = advanced(memory.reference_xy, state[3:5], velocity[:2], elapsed_s, config.position_clamp_m)


@compiled
def _reference(
    memory: MpcMemory, model: RigidBodyState, body: BodyState, demand: Demand, height_m: float, durations: Array
) -> Array:
    """Lay the reference out over the horizon."""
    point, normal = body.position.copy(), body.plane_normal
    point[2] -= body.height
    sag = model.center_of_mass - body.position
    height = height_m + sag[2] + (normal[0] * sag[0] + normal[1] * sag[1]) / normal[2]
    return reference_states(memory.reference_xy, memory.reference_yaw, demand, Ground(point, normal), height, durations)
