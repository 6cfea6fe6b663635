# SPDX-License-Identifier: Apache-2.0
"""Convex model predictive control of the trunk by ground reactions (paper 000, eq 5-32, corrected).

State x = (roll pitch yaw, centre of mass, angular velocity, velocity), input u = forces of the feet in stance, model

    x_{k+1} = A_k x_k + B_k u_k + g_k,   cost = sum ||x_{k+1} - x_ref||^2_Q + ||u_k||^2_W

Steps differ in length and footholds move, so the condensed form uses the products of A_k and B_k. Swing feet are not
variables. Forces are expressed in the stance plane's axes, where the friction pyramid is the same for every foot.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.legged.friction import friction_pyramids
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import rotation_z
from runtime.models.vectors import skews
from runtime.optimization.qp import QpSolver

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
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
    slots: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]


class TrunkMpc:
    """Builds and solves the condensed problem."""

    def __init__(self, config: MpcConfig, solver: QpSolver) -> None:
        self.config = config
        self._solver = solver
        self._sqrt_weight = np.sqrt(
            np.concatenate(
                (
                    config.orientation_weight,
                    config.position_weight,
                    config.angular_velocity_weight,
                    config.velocity_weight,
                )
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
        free, response, slots = _prediction(horizon)
        weighted = (response.reshape(-1, 12, response.shape[1]) * self._sqrt_weight[:, None]).reshape(response.shape)
        error = ((free - horizon.reference) * self._sqrt_weight).ravel()
        hessian = weighted.T @ weighted
        hessian.flat[:: hessian.shape[0] + 1] += config.force_weight
        feet = slots[0].shape[0]
        constraints, lower, upper = friction_pyramids(
            feet, config.friction / np.sqrt(2.0), config.force_min_n, config.force_max_n
        )
        return CondensedProblem(hessian, error @ weighted, constraints, lower, upper, slots)


def _prediction(horizon: Horizon) -> tuple[Array, Array, tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]:
    """Free response (N, 12) and forced response (12 N, n) of the stacked states, and the (step, foot) of each force.

    A velocity change at step k moves the position at the end of step i by itself times (t_{i+1} - t_{k+1}) + dt_k / 2,
    exactly; angles likewise, through T_z^T of the steps in between.
    """
    dt, state = horizon.durations, horizon.state
    steps = dt.shape[0]
    ends = np.cumsum(dt)
    yaw = np.concatenate(([state[2]], horizon.reference[:-1, 2]))
    turn = np.stack([rotation_z(angle).T for angle in yaw])
    turned = np.concatenate((np.zeros((1, 3, 3)), np.cumsum(dt[:, None, None] * turn, axis=0)))

    free = np.empty((steps, 12))
    free[:, :3] = state[:3] + turned[1:] @ state[6:9]
    free[:, 3:6] = state[3:6] + np.outer(ends, state[9:])
    free[:, 5] -= 0.5 * GRAVITY * ends**2
    free[:, 6:9] = state[6:9]
    free[:, 9:] = state[9:]
    free[:, 11] -= GRAVITY * ends

    step, foot = np.nonzero(horizon.stance)
    slots = step, foot
    spin = rotation_z(state[2])
    inverse_inertia = np.linalg.inv(spin @ horizon.inertia @ spin.T)
    arm = skews(horizon.lever[slots])
    gain = dt[step][:, None, None]
    angular = gain * (inverse_inertia @ arm @ horizon.plane)
    linear = gain * horizon.plane / horizon.mass

    later = np.arange(steps)[:, None] >= step
    half_turn = 0.5 * dt[step][:, None, None] * turn[step]
    angle_gain = turned[1:, None] - turned[step + 1] + half_turn
    position_gain = ends[:, None] - ends[step] + 0.5 * dt[step]
    response = np.empty((steps, 12, step.shape[0], 3))
    mask = later[:, :, None, None]
    response[:, 0:3] = (mask * (angle_gain @ angular)).transpose(0, 2, 1, 3)
    response[:, 3:6] = (mask * position_gain[:, :, None, None] * linear).transpose(0, 2, 1, 3)
    response[:, 6:9] = (mask * angular).transpose(0, 2, 1, 3)
    response[:, 9:12] = (mask * linear).transpose(0, 2, 1, 3)
    return free, response.reshape(12 * steps, -1), slots
