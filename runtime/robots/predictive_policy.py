# SPDX-License-Identifier: Apache-2.0
"""The predictive tracker as a controller of a vehicle: from pose and path to the centre angle to command."""

from __future__ import annotations

import math

import numpy as np

from runtime.models.dual_ackermann import centre_curvature
from runtime.models.rotations import wrapped
from runtime.tracking.curvature import curvatures_ahead
from runtime.tracking.drive_tracker_config import SolveMemory
from runtime.tracking.motion import Motion
from runtime.tracking.polyline import ClosestPoint, Polyline
from runtime.tracking.waypoint_pursuit import Pursuit
from runtime.wheeled.tracking_mpc import TrackingMpc, TrackingMpcConfig

SPAN_M = 0.6
"""Length over which the path's curvature is taken: twice the usual spacing of waypoints."""


class PredictivePolicy:
    """Solves at every step, from the angle that the wheels will have; where that fails, the last angle is held.

    What was asked for before has no part in a solution: at a cusp the other end of the vehicle becomes its front, and
    before a new path the wheels may have been steered by somebody else. For the same reason, the angle that is held is
    brought within one step's turn of the wheels.

    Args:
        config: of the predictive tracker.
        memory: last angle, failures and residual.
    """

    def __init__(self, config: TrackingMpcConfig, memory: SolveMemory) -> None:
        self._mpc, self._wheelbase_m, self._memory = TrackingMpc(config), config.wheelbase_m, memory
        self._reach_rad = config.rate_radps * config.step_s

    def __call__(self, path: Polyline, motion: Motion, closest: ClosestPoint) -> Pursuit:
        """The arc for a vehicle that drives forwards; the closest point of the path is known."""
        memory, mpc = self._memory, self._mpc
        spacing, heading = mpc.station_spacing(motion.speed), wrapped(motion.yaw - closest.heading)
        curvatures = np.array(curvatures_ahead(path, closest.progress, spacing, mpc.stations, SPAN_M))
        answer = mpc.solve(closest.lateral_error, heading, motion.angle, motion.angle, motion.speed, curvatures)
        memory.residual[0] = answer.residual
        if answer.solved and math.isfinite(answer.angle):
            memory.angle[0] = answer.angle
        else:
            memory.failures[0] += 1
            memory.angle[0] = self._held(motion.angle)
        return Pursuit(centre_curvature(float(memory.angle[0]), self._wheelbase_m), (closest.x, closest.y), 0.0)

    def _held(self, present: float) -> float:
        """The last angle, or the nearest to it within a step's turn of the wheels; the last, if theirs is unknown."""
        # the first argument is what remains where the other is no number
        return min(max(float(self._memory.angle[0]), present - self._reach_rad), present + self._reach_rad)
