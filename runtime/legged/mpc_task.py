# SPDX-License-Identifier: Apache-2.0
"""The MPC as a task: from the present estimate, command and gait to the ground reactions of one gait cycle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.legged.gait import GaitConfig, foot_phases, knots, scheduled_stance
from runtime.legged.mpc import Horizon, MpcConfig, TrunkMpc
from runtime.legged.posture import PostureConfig
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
        self._latency_ns, self._period_ns = latency_ns, period_ns
        self._body, self._joints, self._command = body, joints, command
        self._gait_state, self._output = gait_state, output
        self._mpc = TrunkMpc(config, solver)
        self._model = RigidBody(description)
        self._shoulders = description.shoulder_positions()
        self._foot_radius = description.foot_radius_m
        self.reads, self.writes = (body, joints, command, gait_state), (output,)
        self.state: MpcMemory = MpcMemory("/ugv/state/mpc", output.sizes)

    def step(self, now_ns: int) -> None:
        """One plan; see `Task`."""
        body = self._body
        if body.stamp_ns == 0 or not self._gait_state.balancing:
            self.state.started = False
            return
        begin_ns = now_ns + self._latency_ns
        horizon, boundaries = self._horizon(begin_ns)
        plan = self._mpc.plan(horizon)
        memory, output = self.state, self._output
        if plan.solved:
            output.stamp_ns = begin_ns
            output.knot_ns = boundaries
            output.stance = horizon.stance.ravel()
            output.force = plan.force.ravel()
            output.cost = plan.cost
        else:
            memory.failures += 1
        output.residual = plan.residual
        output.iterations = plan.iterations
        output.failures = memory.failures

    def _horizon(self, begin_ns: int) -> tuple[Horizon, list[int]]:
        steps = self._config.steps
        gait, body, command = self._gait_state, self._body, self._command
        rotation = matrix_of_quaternion(body.orientation)
        self._model.update(
            body.position,
            body.orientation,
            rotation,
            body.linear_velocity,
            rotation @ body.angular_velocity,
            self._joints.position,
            self._joints.velocity,
        )
        boundaries = knots(self._gait, gait.cycle_start_ns, begin_ns, steps)
        times = np.array(boundaries, dtype=np.int64)
        durations = np.diff(times) * 1e-9
        middles = (times[:-1] + times[1:]) // 2
        if gait.walking:
            stance = np.stack(
                [scheduled_stance(self._gait, foot_phases(self._gait, gait.cycle_start_ns, int(t))) for t in middles]
            )
        else:
            stance = np.ones((steps, 4), dtype=bool)
        state = self._predicted_state(rotation)
        reference, plane = self._reference(state, durations)
        lever = self._levers(stance, middles, begin_ns, state, reference, durations, plane)
        yaw = state[2]
        spin = rotation_z(yaw)
        inertia = spin.T @ self._model.inertia @ spin
        mass = self._model.mass_kg
        horizon = Horizon(state, reference, durations, stance, lever, plane, inertia, mass)
        self._publish_reference(state, reference, command)
        return horizon, boundaries

    def _predicted_state(self, rotation: Array) -> Array:
        """The state when the plan takes effect, under the forces of the plan that is in effect now."""
        body, model = self._body, self._model
        seconds = self._latency_ns * 1e-9
        feet = body.foot_position.reshape(4, 3)
        gait = self._gait_state
        force = self._planned_force(body.stamp_ns) * gait.contact[:, None]
        if not force.any():
            share = model.mass_kg * GRAVITY / max(1, int(gait.contact.sum()))
            force = np.outer(gait.contact, (0.0, 0.0, share))
        acceleration = force.sum(axis=0) / model.mass_kg - (0.0, 0.0, GRAVITY)
        moment = total_moment(feet - model.center_of_mass, force)
        spin = rotation @ body.angular_velocity
        angular = solve_three(model.inertia, moment)
        roll, pitch, yaw = roll_pitch_yaw(rotation)
        turn = rotation_z(yaw).T
        state = np.empty(12)
        state[:3] = (roll, pitch, yaw)
        state[:3] += turn @ (spin * seconds + 0.5 * seconds**2 * angular)
        state[3:6] = model.center_of_mass + seconds * model.com_velocity + 0.5 * seconds**2 * acceleration
        state[6:9] = spin + seconds * angular
        state[9:] = model.com_velocity + seconds * acceleration
        return state

    def _planned_force(self, at_ns: int) -> Array:
        """Forces (4, 3) that the plan in effect holds for a time."""
        output = self._output
        step = int(np.searchsorted(output.knot_ns, at_ns, side="right")) - 1
        step = min(max(step, 0), self._config.steps - 1)
        return output.force.reshape(-1, 4, 3)[step]

    def _reference(self, state: Array, durations: Array) -> tuple[Array, Array]:
        """Reference states (N, 12) along the stance plane, and the plane's axes (3, 3)."""
        memory, command, body = self.state, self._command, self._body
        yaw = state[2]
        if not memory.started:
            memory.started = True
            memory.reference_xy, memory.reference_yaw = state[3:5], yaw
        walking = self._gait_state.walking
        rate = command.yaw_rate if walking else 0.0
        speed = command.velocity if walking else np.zeros(2)
        if walking:
            memory.reference_yaw = yaw + max(-0.3, min(0.3, wrapped(memory.reference_yaw - yaw)))
        period = self._period_ns * 1e-9
        memory.reference_yaw = yaw + wrapped(memory.reference_yaw + rate * period - yaw)
        plane = aligned_with_plane(memory.reference_yaw, body.plane_normal)
        velocity = plane[:, 0] * speed[0] + plane[:, 1] * speed[1]
        away = memory.reference_xy + velocity[:2] * period - state[3:5]
        clamp = self._config.position_clamp_m
        memory.reference_xy = state[3:5] + away * min(1.0, clamp / max(float(np.hypot(away[0], away[1])), 1e-9))

        ends = np.cumsum(durations)
        reference = np.zeros((durations.shape[0], 12))
        roll, pitch, _ = roll_pitch_yaw(plane)
        reference[:, 0], reference[:, 1] = roll, pitch
        reference[:, 2] = memory.reference_yaw + rate * ends
        turns = rate * (ends - 0.5 * durations)
        cosine, sine = np.cos(turns), np.sin(turns)
        along = np.stack((cosine * speed[0] - sine * speed[1], sine * speed[0] + cosine * speed[1]), axis=1)
        velocities = along @ plane[:, :2].T
        reference[:, 9:12] = velocities
        reference[:, 3:5] = memory.reference_xy + np.cumsum(velocities[:, :2] * durations[:, None], axis=0)
        normal = body.plane_normal
        slope = normal[:2] / normal[2]
        sag = self._model.center_of_mass - body.position
        ground = body.position[2] - body.height
        level = ground - (reference[:, 3:5] - body.position[:2]) @ slope
        reference[:, 5] = level + self._posture.height_m + sag[2] + slope @ sag[:2]
        reference[:, 8] = rate
        return reference, plane

    def _levers(
        self,
        stance: npt.NDArray[np.bool_],
        middles: npt.NDArray[np.int64],
        begin_ns: int,
        state: Array,
        reference: Array,
        durations: Array,
        plane: Array,
    ) -> Array:
        """Contact points minus centre of mass, (N, 4, 3): present contacts and footholds first, then neutral points."""
        steps = stance.shape[0]
        gait = self._gait_state
        center = np.concatenate((state[None, 3:6], reference[:, 3:6]))
        # the robot catches up with its reference over the horizon; until then it is where it is
        offset = state[3:6] - (reference[0, 3:6] - reference[0, 9:12] * durations[0])
        fade = np.linspace(1.0, 0.0, steps)[:, None]
        middle = 0.5 * (center[:-1] + center[1:])
        middle[1:] += offset * fade[1:] * (1.0, 1.0, 1.0)
        foothold = gait.foothold.reshape(4, 3)
        points = np.broadcast_to(foothold, (steps, 4, 3)).copy()
        if gait.walking:
            standing = stance[0]
            half = 0.5 * self._gait.stance_s
            for foot in range(4):
                # a foot that stands now leaves and lands again within the horizon
                changes = np.flatnonzero(np.diff(stance[:, foot].astype(np.int8)) == 1) + 1
                first = int(changes[0]) if changes.size else steps
                lands_again = first if standing[foot] else self._second_landing(stance[:, foot], first)
                if lands_again < steps:
                    ahead = half
                    spin = rotation_z(reference[lands_again, 2])
                    shoulder = spin @ (self._shoulders[foot] * (1.0, 1.0, 0.0))
                    below = reference[lands_again, 3:6] + shoulder + reference[lands_again, 9:12] * ahead
                    normal = plane[:, 2]
                    drop = float(normal @ (below - foothold.mean(axis=0)))
                    points[lands_again:, foot] = below - normal * drop
        points -= plane[:, 2] * self._foot_radius
        return points - middle[:, None, :]

    @staticmethod
    def _second_landing(stance: npt.NDArray[np.bool_], first: int) -> int:
        """Step at which a foot that is in the air lands for the second time."""
        steps = stance.shape[0]
        lifts = np.flatnonzero(~stance[first:])
        if not lifts.size:
            return steps
        lift = first + int(lifts[0])
        lands = np.flatnonzero(stance[lift:])
        return lift + int(lands[0]) if lands.size else steps

    def _publish_reference(self, state: Array, reference: Array, command: BodyCommand) -> None:
        output, memory = self._output, self.state
        output.reference_position[:2] = memory.reference_xy
        output.reference_position[2] = reference[0, 5]
        output.reference_velocity = reference[0, 9:12]
        output.reference_orientation = (reference[0, 0], reference[0, 1], memory.reference_yaw)
        output.reference_yaw_rate = command.yaw_rate if self._gait_state.walking else 0.0
