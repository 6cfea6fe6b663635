# SPDX-License-Identifier: Apache-2.0
"""The vehicle's estimator that knows: the simulator's own state (`--estimator truth`)."""

from __future__ import annotations

from runtime.models.rotations import matrix_of_quaternion
from runtime.tasks import Task
from runtime.vehicle_signals import VehicleState, VehicleTruth

RESTING_MPS, RESTING_RADPS = 0.005, 0.005


class VehicleTruthTask(Task):
    """Passes the true pose, twist and slip on.

    Args:
        truth: record read.
        output: record written.
    """

    name = "estimator"

    def __init__(self, truth: VehicleTruth, output: VehicleState) -> None:
        self._truth, self._output = truth, output
        self.reads, self.writes = (truth,), (output,)

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        truth, output = self._truth, self._output
        if truth.stamp_ns == 0 and now_ns > 0:
            return
        output.stamp_ns = now_ns
        output.position, output.orientation = truth.position, truth.orientation
        output.linear_velocity, output.angular_velocity = truth.linear_velocity, truth.angular_velocity
        forward, lateral, _ = (matrix_of_quaternion(truth.orientation).T @ truth.linear_velocity).tolist()
        output.velocity = forward, lateral
        output.slip = truth.slip
        output.resting = (
            max(abs(forward), abs(lateral)) < RESTING_MPS and abs(truth.angular_velocity[2]) < RESTING_RADPS
        )
