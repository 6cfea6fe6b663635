# SPDX-License-Identifier: Apache-2.0
"""The quadratic program that reconciles planned forces with commanded accelerations (paper 000, between eq 42 and 43).

    minimise ||delta_f||^2_W1 + ||delta_b||^2_W2
    subject to  M_b (ddq + [delta_b; 0]) + h_b = J_b^T (f_mpc + delta_f),   friction pyramids on f_mpc + delta_f

The six base rows determine delta_b, so it is eliminated and only the forces of the standing feet remain.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.legged.friction import kept_pyramids
from runtime.models.vectors import turned
from runtime.optimization.linear import solve_positive
from runtime.optimization.qp import QpSolver

Array = npt.NDArray[np.float64]
Weight = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
SQRT_2 = math.sqrt(2.0)


class RelaxationConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Weights and bounds.

    Attributes:
        force_weight: W1.
        linear_weight, angular_weight: W2 for the trunk's linear and angular acceleration.
        friction: coefficient of the ground.
        force_max_n: largest normal force of a foot.
    """

    force_weight: Weight = 1.0
    linear_weight: Weight = 0.1
    angular_weight: Weight = 0.1
    friction: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 0.6
    force_max_n: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 250.0


class RelaxationProblem(NamedTuple):
    """The QP in the forces of the standing feet, in plane axes, and delta_b = change x - demand.

    Attributes:
        hessian: (3 n, 3 n); gradient: (3 n,).
        planned: f_mpc in plane axes, (3 n,).
        change: (6, 3 n); demand: (6,).
    """

    hessian: Array
    gradient: Array
    planned: Array
    change: Array
    demand: Array


class Relaxation(NamedTuple):
    """Forces in plane axes (3 n,) that satisfy the base dynamics with `RelaxationProblem.change`, and how good."""

    force: Array
    solved: bool
    residual: float


@compiled
def relaxation_problem(
    config: RelaxationConfig,
    base_inertia: Array,
    unbalanced: Array,
    base_jacobian: Array,
    planned: Array,
    plane: Array,
) -> RelaxationProblem:
    """Eliminate delta_b.

    Args:
        config: weights and bounds.
        base_inertia: M's base block, (6, 6).
        unbalanced: base rows of M ddq + h, (6,): the wrench that the feet have to supply.
        base_jacobian: base columns of the stacked contact Jacobian, (3 n, 6).
        planned: f_mpc, (n, 3), in odom.
        plane: columns are the tangents and the normal of the stance plane, (3, 3).
    """
    feet = planned.shape[0]
    sides, in_plane = np.empty((6, 3 * feet + 1)), np.empty(3 * feet)
    sides[:, 3 * feet] = unbalanced
    for foot in range(feet):
        xyz = slice(3 * foot, 3 * foot + 3)
        in_plane[xyz] = turned(plane.T, planned[foot])
        for row in range(6):
            sides[row, xyz] = turned(plane.T, base_jacobian[xyz, row])
    response = solve_positive(base_inertia, sides)
    change, demand = response[:, : 3 * feet].copy(), response[:, 3 * feet].copy()
    weighted = change.copy()
    weighted[:3] *= config.linear_weight
    weighted[3:] *= config.angular_weight
    hessian = weighted.T @ change
    for row in range(3 * feet):
        hessian[row, row] += config.force_weight
    gradient = -(demand @ weighted) - config.force_weight * in_plane
    return RelaxationProblem(hessian, gradient, in_plane, change, demand)


def relax(config: RelaxationConfig, solver: QpSolver, problem: RelaxationProblem) -> Relaxation:
    """Solve for the forces of the standing feet; if that fails, the planned ones are kept and `solved` is false."""
    feet = problem.planned.shape[0] // 3
    constraints, lower, upper = kept_pyramids(feet, config.friction / SQRT_2, 0.0, config.force_max_n)
    solution = solver.search(problem.hessian, problem.gradient, constraints, lower, upper)
    return Relaxation(solution.x if solution.solved else problem.planned, solution.solved, solution.residual)
