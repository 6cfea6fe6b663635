# SPDX-License-Identifier: Apache-2.0
"""Convex model predictive control of the trunk by ground reactions (paper 000, eq 5-32, corrected).

State x = (roll pitch yaw, centre of mass, angular velocity, velocity), input u = forces of the feet in stance, model

    x_{k+1} = A_k x_k + B_k u_k + g_k,   cost = sum ||x_{k+1} - x_ref||^2_Q + ||u_k||^2_W

Steps differ in length and footholds move, so the condensed form uses the products of A_k and B_k. Swing feet are not
variables. Forces are expressed in the stance plane's axes, where the friction pyramid is the same for every foot.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, compiled_long
from runtime.legged.friction import kept_pyramids
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import rotation_z
from runtime.models.vectors import cross, solve_three, turned
from runtime.optimization.qp import QpSolver

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Slots = npt.NDArray[np.intp]
Weight = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
Weights3 = tuple[Weight, Weight, Weight]


class MpcConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the predictive control.

    Attributes:
        steps: N, steps of the horizon, which spans one gait cycle.
        orientation_weight, position_weight, angular_velocity_weight, velocity_weight: diagonal of Q, for x y z.
        force_weight: diagonal of W.
        friction: coefficient mu of the ground; the pyramid uses mu / sqrt(2).
        force_min_n, force_max_n: normal force of a standing foot.
        position_clamp_m: how far the position reference may run away from the robot.
        heading_clamp_rad: the same for the heading.
    """

    steps: Annotated[int, msgspec.Meta(ge=4, le=20)] = 10
    orientation_weight: Weights3 = (5.0, 5.0, 10.0)
    position_weight: Weights3 = (20.0, 20.0, 100.0)
    angular_velocity_weight: Weights3 = (0.1, 0.1, 0.3)
    velocity_weight: Weights3 = (1.0, 1.0, 1.0)
    force_weight: Weight = 1e-5
    friction: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 0.6
    force_min_n: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 5.0
    force_max_n: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 200.0
    position_clamp_m: Annotated[float, msgspec.Meta(gt=0.0, le=0.5)] = 0.1
    heading_clamp_rad: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 0.3


class Horizon(NamedTuple):
    """What the plan is made for, over N steps.

    Attributes:
        state: x_0, (12,).
        reference: x_ref at the end of each step, (N, 12).
        durations: of the steps, (N,), s.
        stance: feet that stand, (N, 4).
        lever: contact point minus centre of mass, (N, 4, 3), m, in odom.
        plane: columns are the stance plane's tangents and normal, (3, 3).
        inertia: of the whole robot about its centre of mass at yaw 0, (3, 3).
        mass: kg.
    """

    state: Array
    reference: Array
    durations: Array
    stance: Mask
    lever: Array
    plane: Array
    inertia: Array
    mass: float


class Plan(NamedTuple):
    """Ground reactions of the horizon.

    Attributes:
        force: (N, 4, 3), N, in odom; zero for feet in the air.
        solved: the solver succeeded and its residual is small.
        residual, iterations, cost: of the solve.
    """

    force: Array
    solved: bool
    residual: float
    iterations: int
    cost: float


class CondensedProblem(NamedTuple):
    """The QP in the stacked forces of the standing feet, in plane axes."""

    hessian: Array
    gradient: Array
    constraints: Array
    lower: Array
    upper: Array
    slots: tuple[Slots, Slots]


class TrunkMpc:
    """Builds and solves the condensed problem."""

    def __init__(self, config: MpcConfig, solver: QpSolver) -> None:
        self.config = config
        self._solver = solver
        self._weight = np.concatenate(
            (
                config.orientation_weight,
                config.position_weight,
                config.angular_velocity_weight,
                config.velocity_weight,
            )
        )

    def plan(self, horizon: Horizon) -> Plan:
        """The optimal ground reactions."""
        problem = self.condense(horizon)
        solution = self._solver.solve(*problem[:5])
        force = np.zeros((horizon.durations.shape[0], 4, 3))
        if solution.solved:
            force[problem.slots] = solution.x.reshape(-1, 3) @ horizon.plane.T
        return Plan(force, solution.solved, solution.residual, solution.iterations, solution.cost)

    def condense(self, horizon: Horizon) -> CondensedProblem:
        """The QP of a horizon (eq 25-31)."""
        config = self.config
        hessian, gradient, step, foot = _condense(horizon, self._weight, config.force_weight)
        constraints, lower, upper = kept_pyramids(
            step.shape[0], config.friction / math.sqrt(2.0), config.force_min_n, config.force_max_n
        )
        return CondensedProblem(hessian, gradient, constraints, lower, upper, (step, foot))


@compiled_long
def _condense(horizon: Horizon, weight: Array, force_weight: float) -> tuple[Array, Array, Slots, Slots]:
    """Hessian and gradient (eq 28-30), and the step and the foot of each force."""
    step, foot = np.nonzero(horizon.stance)
    free, response = _free_response(horizon), _forced_response(horizon, step, foot)
    scale = np.sqrt(weight)
    error = ((free - horizon.reference) * scale).ravel()
    for row in range(response.shape[0]):
        response[row] *= scale[row % 12]
    hessian = response.T @ response
    for row in range(hessian.shape[0]):
        hessian[row, row] += force_weight
    return hessian, error @ response, step, foot


@compiled
def _turns(horizon: Horizon) -> tuple[Array, Array]:
    """T_z^T of each step (N, 3, 3), and its integral over time at the begin of each step and at the end, (N + 1, 3, 3).

    The yaw of a step is the reference's at its begin.
    """
    steps = horizon.durations.shape[0]
    turn, integral = np.empty((steps, 3, 3)), np.zeros((steps + 1, 3, 3))
    for step in range(steps):
        yaw = horizon.state[2] if step == 0 else horizon.reference[step - 1, 2]
        turn[step] = rotation_z(yaw).T
        integral[step + 1] = integral[step] + horizon.durations[step] * turn[step]
    return turn, integral


@compiled
def _free_response(horizon: Horizon) -> Array:
    """States (N, 12) at the ends of the steps without any force but gravity."""
    state = horizon.state
    _, integral = _turns(horizon)
    free, end = np.empty_like(horizon.reference), 0.0
    for step in range(free.shape[0]):
        end += horizon.durations[step]
        free[step, :3] = state[:3] + turned(integral[step + 1], state[6:9])
        free[step, 3:6] = state[3:6] + end * state[9:]
        free[step, 5] -= 0.5 * GRAVITY * end**2
        free[step, 6:] = state[6:]
        free[step, 11] -= GRAVITY * end
    return free


@compiled
def _forced_response(horizon: Horizon, step: Slots, foot: Slots) -> Array:
    """What the forces in plane axes add to the stacked states, (12 N, 3 n).

    A velocity change at step k moves the position at the end of step i by itself times (t_{i+1} - t_{k+1}) + dt_k / 2,
    exactly; angles likewise, through T_z^T of the steps in between.
    """
    turn, integral = _turns(horizon)
    steps, end, spin = turn.shape[0], np.cumsum(horizon.durations), rotation_z(horizon.state[2])
    inertia = spin @ horizon.inertia @ spin.T
    response = np.zeros((12 * steps, 3 * step.shape[0]))
    for slot in range(step.shape[0]):
        k, lever = step[slot], horizon.lever[step[slot], foot[slot]]
        dt = horizon.durations[k]
        for axis in range(3):
            column, force = response[:, 3 * slot + axis], horizon.plane[:, axis]
            angular, linear = dt * solve_three(inertia, cross(lever, force)), dt / horizon.mass * force
            for i in range(k, steps):
                gain = integral[i + 1] - integral[k + 1] + 0.5 * dt * turn[k]
                column[12 * i : 12 * i + 3] = turned(gain, angular)
                column[12 * i + 3 : 12 * i + 6] = (end[i] - end[k] + 0.5 * dt) * linear
                column[12 * i + 6 : 12 * i + 9] = angular
                column[12 * i + 9 : 12 * i + 12] = linear
    return response
