# SPDX-License-Identifier: Apache-2.0
"""The MPC as a task: from the present estimate, command and gait to the ground reactions of one gait cycle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.legged.contact_plan import contact_points, nominal_centers, stance_schedule
from runtime.legged.gait import GaitConfig, knots
from runtime.legged.mpc import Horizon, MpcConfig, TrunkMpc
from runtime.legged.posture import PostureConfig
from runtime.legged.reference import Demand, Ground, advanced, reference_states, velocity_along
from runtime.legged.whole_body import planned_force
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY, RigidBody
from runtime.models.rotations import (
    aligned_with_plane,
    matrix_of_quaternion,
    roll_pitch_yaw,
    rotation_z,
    wrapped,
)
from runtime.models.vectors import solve_three, total_moment
from runtime.optimization.qp import QpSolver
from runtime.records import Record, boolean, float64, float64_array, uint32
from runtime.signals import BodyCommand, BodyState, ContactForces, Gait, JointState
from runtime.tasks import Task

Array = npt.NDArray[np.float64]


class MpcMemory(Record):
    """What the MPC must remember."""

    started = boolean()
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
        self._config, self._gait, self._posture = config, gait, posture
        self._latency_ns, self._period_s = latency_ns, period_ns * 1e-9
        self._body, self._joints, self._command = body, joints, command
        self._gait_state, self._output = gait_state, output
        self._mpc = TrunkMpc(config, solver)
        self._model = RigidBody(description)
        self._shoulders = description.shoulder_positions()
        self._foot_radius = description.foot_radius_m
        self.reads, self.writes = (body, joints, command, gait_state), (output,)
        self.state: MpcMemory = MpcMemory("/ugv/state/mpc", output.sizes)

    def step(self, now_ns: int) -> None:
        """One plan; see `Task`. If it cannot be found, the last good one stays and the failure is counted."""
        memory, output = self.state, self._output
        if self._body.stamp_ns == 0 or not self._gait_state.balancing:
            memory.started = False
            return
        begin_ns = now_ns + self._latency_ns
        boundaries = knots(self._gait, self._gait_state.cycle_start_ns, begin_ns, self._config.steps)
        horizon = self._horizon(boundaries)
        if not np.isfinite(horizon.reference).all():
            memory.started = False  # the reference starts anew from the next finite state
        plan = self._mpc.plan(horizon)
        if plan.solved:
            output.stamp_ns, output.knot_ns = begin_ns, boundaries
            output.stance, output.force, output.cost = horizon.stance.ravel(), plan.force.ravel(), plan.cost
            self._publish_reference(horizon.reference)
        else:
            memory.failures += 1
        output.residual, output.iterations, output.failures = plan.residual, plan.iterations, memory.failures

    def _horizon(self, boundaries: list[int]) -> Horizon:
        """Everything that the plan is made for."""
        body, gait, model = self._body, self._gait_state, self._model
        rotation = matrix_of_quaternion(body.orientation)
        spin = rotation @ body.angular_velocity
        model.update(
            body.position,
            body.orientation,
            rotation,
            body.linear_velocity,
            spin,
            self._joints.position,
            self._joints.velocity,
        )
        durations: Array = np.diff(np.array(boundaries, dtype=np.int64)).astype(np.float64) * 1e-9
        state = self._predicted_state(rotation, spin)
        reference = self._reference(state, durations)
        stance = np.ones((self._config.steps, 4), dtype=bool)
        if gait.walking:
            stance = stance_schedule(self._gait, gait.cycle_start_ns, boundaries)
        normal = body.plane_normal
        feet = contact_points(
            stance, gait.foothold.reshape(4, 3), self._shoulders, reference, normal, self._gait.stance_s
        )
        center = nominal_centers(state[3:6], reference, durations)
        lever = feet - self._foot_radius * normal - center[:, None]
        plane = aligned_with_plane(self.state.reference_yaw, normal)
        heading = rotation_z(state[2])
        inertia = heading.T @ model.inertia @ heading
        return Horizon(state, reference, durations, stance, lever, plane, inertia, model.mass_kg)

    def _predicted_state(self, rotation: Array, spin: Array) -> Array:
        """The state when the plan takes effect, under the forces of the plan that is in effect now."""
        body, model, contact = self._body, self._model, self._gait_state.contact
        force = planned_force(self._output, body.stamp_ns) * contact[:, None]
        if not force.any():
            share = model.mass_kg * GRAVITY / max(1, int(contact.sum()))
            force = np.outer(contact, (0.0, 0.0, share))
        seconds = self._latency_ns * 1e-9
        acceleration = force.sum(axis=0) / model.mass_kg - (0.0, 0.0, GRAVITY)
        arms = body.foot_position.reshape(4, 3) - model.center_of_mass
        angular = solve_three(model.inertia, total_moment(arms, force))
        angles = roll_pitch_yaw(rotation)
        state = np.empty(12)
        state[:3] = angles + rotation_z(angles[2]).T @ (seconds * spin + 0.5 * seconds**2 * angular)
        state[3:6] = model.center_of_mass + seconds * model.com_velocity + 0.5 * seconds**2 * acceleration
        state[6:9] = spin + seconds * angular
        state[9:] = model.com_velocity + seconds * acceleration
        return state

    def _reference(self, state: Array, durations: Array) -> Array:
        """Move the reference on by one period, and lay it out over the horizon."""
        memory, command, body = self.state, self._command, self._body
        if not memory.started:
            memory.started = True
            memory.reference_xy, memory.reference_yaw = state[3:5], state[2]
        demand = Demand(0.0, 0.0, 0.0)
        if self._gait_state.walking:
            forward, lateral = command.velocity.tolist()
            demand = Demand(forward, lateral, command.yaw_rate)
        clamp = self._config.heading_clamp_rad
        ahead = wrapped(memory.reference_yaw + demand.yaw_rate * self._period_s - state[2])
        memory.reference_yaw = state[2] + max(-clamp, min(clamp, ahead))
        plane = aligned_with_plane(memory.reference_yaw, body.plane_normal)
        velocity = velocity_along(plane, demand)[:2]
        memory.reference_xy = advanced(
            memory.reference_xy, state[3:5], velocity, self._period_s, self._config.position_clamp_m
        )
        ground = Ground(body.position - (0.0, 0.0, body.height), body.plane_normal)
        sag = self._model.center_of_mass - body.position
        slope = body.plane_normal[:2] / body.plane_normal[2]
        height = self._posture.height_m + sag[2] + slope @ sag[:2]
        return reference_states(memory.reference_xy, memory.reference_yaw, demand, ground, height, durations)

    def _publish_reference(self, reference: Array) -> None:
        """What the whole-body control holds the trunk to until the next plan."""
        output, memory, first = self._output, self.state, reference[0]
        output.reference_position = (*memory.reference_xy, first[5])
        output.reference_velocity = first[9:12]
        output.reference_orientation = (first[0], first[1], memory.reference_yaw)
        output.reference_yaw_rate = first[8]
