# SPDX-License-Identifier: Apache-2.0
"""The task that learns how late a vehicle answers, from the commands that were sent and what its wheels did."""

from __future__ import annotations

from runtime.models.vehicle import VehicleGeometry
from runtime.records import Record, float64_array
from runtime.tasks import Task
from runtime.tracking.delay_estimation import DelayConfig, DelayEstimator
from runtime.tracking.vehicle_answer import VehicleAnswer
from runtime.tracking.wheel_motion import centre_angle, rolling_speed
from runtime.vehicle_signals import CommandDelay, WheelCommand, WheelState


class DelayMemory(Record):
    """What a `DelayEstimator` remembers."""

    learnt = float64_array(DelayEstimator.SIZE)


class DelayTask(Task):
    """Learns the delay from a command to the wheels while they are to obey.

    Args:
        config: parameters.
        answer: of the vehicle, the delay apart.
        geometry: of the vehicle.
        wheels: record read.
        command: record read: what was sent last.
        output: record written.
    """

    name = "delay"

    def __init__(
        self,
        config: DelayConfig,
        answer: VehicleAnswer,
        geometry: VehicleGeometry,
        wheels: WheelState,
        command: WheelCommand,
        output: CommandDelay,
    ) -> None:
        self._geometry, self._wheels, self._command, self._output = geometry, wheels, command, output
        self.reads, self.writes = (wheels, command), (output,)
        self.state: DelayMemory = DelayMemory("/ugv/state/delay")
        self._estimator = DelayEstimator(config, answer, self.state.learnt)
        self._estimator.forget()

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        wheels, command, estimator = self._wheels, self._command, self._estimator
        if command.enable and wheels.enabled:
            estimator.add(command.stamp_ns * 1e-9, *self._motion_of(command))
            speed, angle = self._motion_of(wheels)
            estimator.step(now_ns * 1e-9, angle, speed)
        else:
            estimator.pause()
        self._output.stamp_ns, self._output.delay = now_ns, estimator.delay_s

    def _motion_of(self, wheels: WheelState | WheelCommand) -> tuple[float, float]:
        """Speed, m/s, and centre angle, rad."""
        geometry = self._geometry
        return rolling_speed(wheels.speed, geometry.wheel_radius_m), centre_angle(wheels.steering, geometry)
