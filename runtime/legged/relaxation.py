# SPDX-License-Identifier: Apache-2.0
"""The quadratic program that reconciles planned forces with commanded accelerations (paper 000, between eq 42 and 43).

    minimise ||delta_f||^2_W1 + ||delta_b||^2_W2
    subject to  M_b (ddq + [delta_b; 0]) + h_b = J_b^T (f_mpc + delta_f),   friction pyramids on f_mpc + delta_f

The six base rows determine delta_b, so it is eliminated and only the forces of the standing feet remain.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from runtime.legged.friction import friction_pyramids
from runtime.optimization.qp import QpSolver

Array = npt.NDArray[np.float64]
Weight = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]


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


class Relaxation(NamedTuple):
    """Forces (n, 3) and body acceleration change (6,) that satisfy the base dynamics."""

    force: Array
    delta_b: Array
    solved: bool
    residual: float


def relax(
    config: RelaxationConfig,
    solver: QpSolver,
    base_inertia: Array,
    unbalanced: Array,
    base_jacobian: Array,
    planned: Array,
    plane: Array,
) -> Relaxation:
    """Solve for the forces of the standing feet.

    Args:
        config: weights and bounds.
        solver: of the QP.
        base_inertia: M's base block, (6, 6).
        unbalanced: base rows of M ddq + h, (6,): the wrench that the feet have to supply.
        base_jacobian: base columns of the stacked contact Jacobian, (3 n, 6).
        planned: f_mpc, (n, 3), in odom.
        plane: columns are the tangents and the normal of the stance plane, (3, 3).

    If the QP cannot be solved, the planned forces are kept and `solved` is false.
    """
    feet = planned.shape[0]
    sides = np.empty((6, 3 * feet + 1))
    sides[:, :-1] = (base_jacobian.reshape(feet, 3, 6).transpose(2, 0, 1) @ plane).reshape(6, -1)
    sides[:, -1] = unbalanced
    _, response, _ = lapack.dposv(base_inertia, sides)
    change, demand = response[:, :-1], response[:, -1]
    weighted = change * _weights(config.linear_weight, config.angular_weight)
    planned_axes = (planned @ plane).ravel()
    hessian = weighted.T @ change
    hessian.flat[:: hessian.shape[0] + 1] += config.force_weight
    gradient = -(weighted.T @ demand) - config.force_weight * planned_axes
    constraints, lower, upper = friction_pyramids(feet, config.friction / np.sqrt(2.0), 0.0, config.force_max_n)
    solution = solver.solve(hessian, gradient, constraints, lower, upper)
    chosen = solution.x if solution.solved else planned_axes
    delta_b = change @ chosen - demand
    return Relaxation(chosen.reshape(feet, 3) @ plane.T, delta_b, solution.solved, solution.residual)


@cache
def _weights(linear: float, angular: float) -> Array:
    return np.repeat((linear, angular), 3)[:, None]
