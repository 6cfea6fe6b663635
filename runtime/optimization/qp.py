# SPDX-License-Identifier: Apache-2.0
"""Convex quadratic programs behind one interface.

    minimise 1/2 x^T H x + g^T x   subject to   lower <= [x; C x] <= upper

Each solve is stateless: the same numbers give the same bits in any process, which replay depends on. The status *and*
the residual of every solve are checked.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import math
from abc import ABC, abstractmethod
from functools import cache
from typing import Any, NamedTuple, Protocol

import daqp
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, compiled_long
from runtime.optimization.linear import solve_positive

Array = npt.NDArray[np.float64]

RESIDUAL_TOLERANCE = 1e-5
"""Largest accepted violation of the optimality conditions, relative to the gradient's and bounds' magnitude."""


GRADIENT_SCALE = 100.0
"""Size in which proxsuite is given the gradient: its thresholds are absolute, and small ones look infeasible to it."""
_TINY = 1e-12


class QpSolution(NamedTuple):
    """The answer to one quadratic program.

    Attributes:
        x: minimiser, meaningful only if `solved`.
        solved: the solver reported success and the residual confirms it.
        residual: largest violation of stationarity or feasibility, relative to the magnitude of the data.
        iterations: the solver's count.
        cost: value of the objective.
    """

    x: Array
    solved: bool
    residual: float
    iterations: int
    cost: float


class QpSolver(Protocol):
    """Solves a strictly convex QP whose first bounds are on the variables and the others on `constraints @ x`."""

    def solve(
        self,
        hessian: Array,
        gradient: Array,
        constraints: Array,
        lower: Array,
        upper: Array,
    ) -> QpSolution:
        """Solve from scratch."""

    def search(
        self,
        hessian: Array,
        gradient: Array,
        constraints: Array,
        lower: Array,
        upper: Array,
    ) -> QpSolution:
        """Solve from scratch a problem of which is known that it has no interior solution."""


@compiled
def relative_residual(
    x: Array,
    multipliers: Array,
    hessian: Array,
    gradient: Array,
    constraints: Array,
    lower: Array,
    upper: Array,
) -> float:
    """Largest relative violation of the optimality conditions; infinity if anything is not finite.

    The conditions are stationarity, feasibility, and that a multiplier pushes only away from a bound that is reached: a
    positive one from the upper, a negative one from the lower.
    """
    variables = x.shape[0]
    stationarity = hessian @ x + gradient + multipliers[:variables] + multipliers[variables:] @ constraints
    values = np.concatenate((x, constraints @ x))
    above, below = upper - values, values - lower
    slack = np.minimum(np.where(multipliers > 0.0, above, below), np.abs(multipliers)).max()
    force, size = 1.0 + np.abs(gradient).max(), 1.0 + np.abs(values).max()
    steepest, outside = np.abs(stationarity).max() / force, -np.minimum(above, below).min() / size
    residual = max(steepest, outside, slack / min(force, size))
    return residual if math.isfinite(steepest + outside + slack) else math.inf


@compiled_long
def interior_solution(
    hessian: Array, gradient: Array, constraints: Array, lower: Array, upper: Array
) -> tuple[bool, Array, float]:
    """The unconstrained minimiser, if the Hessian is positive definite and no bound stands in its way.

    Most problems of a walking robot are of this kind, and a Cholesky factorisation is all that they cost.

    Returns:
        Whether it is the answer, and if so itself and its residual.
    """
    size = gradient.shape[0]
    x = solve_positive(hessian, -gradient.reshape(size, 1))[:, 0].copy()
    values = np.concatenate((x, constraints @ x))
    inside = (values <= upper).all() and (values >= lower).all()
    if not inside:
        return False, x, math.inf
    stationarity = hessian @ x + gradient
    return True, x, np.abs(stationarity).max() / (1.0 + np.abs(gradient).max())


class _Solver(ABC):
    """What is the same whoever searches: the attempt to do without, and the refusal of data that are not finite."""

    def __init__(self) -> None:
        # what is compiled or loaded at first use is there before it counts
        self.solve(np.eye(1), -np.ones(1), np.zeros((1, 1)), np.zeros(2), np.array([0.5, 1.0]))

    def solve(self, hessian: Array, gradient: Array, constraints: Array, lower: Array, upper: Array) -> QpSolution:
        """Solve; see `QpSolver`."""
        inside, x, residual = interior_solution(hessian, gradient, constraints, lower, upper)
        if inside:
            return QpSolution(x, residual < RESIDUAL_TOLERANCE, residual, 0, 0.5 * float(gradient @ x))
        return self.search(hessian, gradient, constraints, lower, upper)

    def search(self, hessian: Array, gradient: Array, constraints: Array, lower: Array, upper: Array) -> QpSolution:
        """Solve by the solver; see `QpSolver`."""
        # the sum of finite numbers of the sizes that occur is finite
        if not math.isfinite(float(hessian.sum() + gradient.sum())):
            return QpSolution(np.zeros_like(gradient), False, math.inf, 0, math.nan)
        return self._search(hessian, gradient, constraints, lower, upper)

    @abstractmethod
    def _search(self, hessian: Array, gradient: Array, constraints: Array, lower: Array, upper: Array) -> QpSolution:
        """Solve a problem of finite numbers."""


class Daqp(_Solver):
    """Dual active-set solver; does not hold the GIL and is reproducible to the bit."""

    def __init__(self, iteration_limit: int = 500) -> None:
        self._iteration_limit = iteration_limit
        super().__init__()

    def _search(self, hessian: Array, gradient: Array, constraints: Array, lower: Array, upper: Array) -> QpSolution:
        x, cost, flag, info = daqp.solve(
            hessian,
            gradient,
            constraints,
            upper,
            lower,
            iter_limit=self._iteration_limit,
        )
        if flag <= 0:
            return QpSolution(x, False, math.inf, int(info["iterations"]), float(cost))
        residual = relative_residual(x, info["lam"], hessian, gradient, constraints, lower, upper)
        return QpSolution(x, residual < RESIDUAL_TOLERANCE, residual, int(info["iterations"]), float(cost))


@cache
def _proxsuite_baseline() -> Any:
    """The extension module of proxsuite's baseline build; importing the package would load a vectorised one instead."""
    package = importlib.util.find_spec("proxsuite")
    if package is None or not package.submodule_search_locations:
        raise ImportError("the proxqp solver needs the package proxsuite")
    finder = importlib.machinery.PathFinder()
    spec = finder.find_spec("proxsuite_pywrap", list(package.submodule_search_locations))
    if spec is None or spec.loader is None:
        raise ImportError("the package proxsuite holds no baseline build (proxsuite_pywrap)")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Proxqp(_Solver):
    """proxsuite's augmented-Lagrangian solver, in its baseline build, whose results do not depend on heap addresses."""

    def __init__(self, iteration_limit: int = 200, accuracy: float = 1e-9) -> None:
        self._module = _proxsuite_baseline()
        self._iteration_limit, self._accuracy = iteration_limit, accuracy
        super().__init__()

    def _search(self, hessian: Array, gradient: Array, constraints: Array, lower: Array, upper: Array) -> QpSolution:
        variables = gradient.shape[0]
        rows = np.vstack((np.eye(variables), constraints))
        scale = GRADIENT_SCALE / max(float(np.abs(gradient).max()), _TINY)
        dense = self._module.proxqp.dense
        result = dense.solve_no_gil(
            scale * hessian,
            scale * gradient,
            None,
            None,
            rows,
            lower,
            upper,
            eps_abs=self._accuracy,
            max_iter=self._iteration_limit,
        )
        x = np.asarray(result.x)
        solved = result.info.status == self._module.proxqp.QPSolverOutput.PROXQP_SOLVED
        residual = relative_residual(x, np.asarray(result.z) / scale, hessian, gradient, constraints, lower, upper)
        return QpSolution(
            x,
            solved and residual < RESIDUAL_TOLERANCE,
            residual,
            int(result.info.iter),
            float(result.info.objValue) / scale,
        )


SOLVERS = {"daqp": Daqp, "proxqp": Proxqp}
"""Solvers by the name that a robot's TOML gives."""
