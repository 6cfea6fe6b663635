# SPDX-License-Identifier: Apache-2.0
"""Model predictive path tracking: the strong peer of the geometric methods.

In the frame of the path the state is the lateral error e, the heading error psi and the centre angle delta, and the
input the commanded centre angle u:

    e'     = v sin(psi)
    psi'   = v (2 tan(delta) / L - kappa)
    delta' = (u - delta) / tau

made linear about the curvature of the path, where the secant of the sine at the present heading error stands for its
slope. The commands' delay is in the initial state, which is the one at which the first input takes effect. The rate of
the inputs is bounded by that of the steering. One quadratic program a step.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from runtime.optimization.qp import SOLVERS, QpSolver

Array = npt.NDArray[np.float64]
Weight = Annotated[float, Meta(ge=0.0, le=1e6)]
Positive = Annotated[float, Meta(gt=0.0, le=20.0)]


class TrackingMpcConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the predictive tracker.

    Attributes:
        wheelbase_m: L.
        rate_radps: greatest rate of the centre angle, r.
        lag_s: time constant of the centre angle, tau.
        maximum_rad: greatest centre angle.
        horizon: number of steps.
        step_s: duration of one.
        lateral_weight: on e^2, 1/m^2.
        heading_weight: on psi^2.
        steering_weight: on the input's difference from the angle of the path's own curvature, squared.
        change_weight: on the squared change of the input from step to step.
        slowest_mps: speed below which the model is that at this speed.
        solver: of `runtime.optimization.qp`.
    """

    wheelbase_m: Positive = 1.17
    rate_radps: Positive = math.radians(20.0)
    lag_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.05
    maximum_rad: Annotated[float, Meta(gt=0.0, le=1.4)] = 0.4
    horizon: Annotated[int, Meta(ge=2, le=60)] = 25
    step_s: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.16
    lateral_weight: Weight = 4.0
    heading_weight: Weight = 1.0
    steering_weight: Weight = 0.1
    change_weight: Weight = 1.0
    slowest_mps: Positive = 0.2
    solver: Literal["daqp", "proxqp"] = "proxqp"


class MpcAnswer(NamedTuple):
    """What a step gives.

    Attributes:
        angle: centre angle to command, rad; meaningful only if `solved`.
        solved: the solver's answer is the optimum.
        residual: of the solve.
    """

    angle: float
    solved: bool
    residual: float


class TrackingMpc:
    """Solves for the centre angle to command; keeps nothing from step to step."""

    def __init__(self, config: TrackingMpcConfig | None = None, solver: QpSolver | None = None) -> None:
        self._config = config or TrackingMpcConfig()
        self._solver = solver or SOLVERS[self._config.solver]()
        count = self._config.horizon
        self._changes = np.eye(count) - np.eye(count, k=-1)

    @property
    def stations(self) -> int:
        """Number of curvatures of the path that a step needs."""
        return self._config.horizon

    def station_spacing(self, speed: float) -> float:
        """Arc length between them, m, at a speed."""
        return max(speed, self._config.slowest_mps) * self._config.step_s

    def solve(
        self, lateral: float, heading: float, angle: float, command: float, speed: float, curvatures: Array
    ) -> MpcAnswer:
        """The first input of the best sequence.

        Args:
            lateral: e when the input takes effect, m, positive with the path to the right.
            heading: psi then, rad.
            angle: delta then, rad.
            command: the input before, rad.
            speed: m/s.
            curvatures: of the path at the stations from there on, 1/m, `stations` of them.
        """
        config = self._config
        count, v = config.horizon, max(speed, config.slowest_mps)
        references = np.arctan(0.5 * config.wheelbase_m * curvatures)
        free, forced = self._predicted(np.array([lateral, heading, angle]), v, references)
        states = np.array([config.lateral_weight, config.heading_weight])
        hessian = np.einsum("nsi,s,nsj->ij", forced[:, :2], states, forced[:, :2])
        gradient = np.einsum("nsi,s,ns->i", forced[:, :2], states, free[:, :2])
        hessian += config.steering_weight * np.eye(count) + config.change_weight * self._changes.T @ self._changes
        before = np.zeros(count)
        before[0] = command
        gradient -= config.steering_weight * references + config.change_weight * self._changes.T @ before
        most = config.rate_radps * config.step_s
        bound = max(config.maximum_rad, abs(command))
        lower = np.concatenate((np.full(count, -bound), before - most))
        upper = np.concatenate((np.full(count, bound), before + most))
        solution = self._solver.solve(hessian, gradient, self._changes, lower, upper)
        return MpcAnswer(float(solution.x[0]), solution.solved, solution.residual)

    def _predicted(self, state: Array, speed: float, references: Array) -> tuple[Array, Array]:
        """States over the horizon, (n, 3), without input, and their slopes in the inputs, (n, 3, n)."""
        config = self._config
        count, dt = config.horizon, config.step_s
        secant = float(np.sinc(state[1] / math.pi))
        share = -math.expm1(-dt / config.lag_s) if config.lag_s > 0.0 else 1.0
        free, forced = np.empty((count, 3)), np.zeros((count, 3, count))
        slopes = 2.0 * speed * dt / (config.wheelbase_m * np.cos(references) ** 2)
        offset, slope = state, np.zeros((3, count))
        for step in range(count):
            # the angle within the step is the mean of those at its ends, and the heading likewise
            angle, angle_slope = (1.0 - share) * offset[2], (1.0 - share) * slope[2]
            angle_slope[step] += share
            turn = slopes[step] * (0.5 * (offset[2] + angle) - references[step])
            turn_slope = 0.5 * slopes[step] * (slope[2] + angle_slope)
            way = speed * dt * secant
            offset = np.array([offset[0] + way * (offset[1] + 0.5 * turn), offset[1] + turn, angle])
            slope = np.stack((slope[0] + way * (slope[1] + 0.5 * turn_slope), slope[1] + turn_slope, angle_slope))
            free[step], forced[step] = offset, slope
        return free, forced
