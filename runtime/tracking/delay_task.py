# SPDX-License-Identifier: Apache-2.0
"""The task that learns how late a vehicle answers, from the commands that were sent and what its wheels did."""

from __future__ import annotations

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
        wheel_radius_m: of each wheel.
        wheels: record read.
        command: record read: what was sent last.
        output: record written.
    """

    name = "delay"

    def __init__(
        self,
        config: DelayConfig,
        answer: VehicleAnswer,
        wheel_radius_m: float,
        wheels: WheelState,
        command: WheelCommand,
        output: CommandDelay,
    ) -> None:
        self._radius_m, self._wheels, self._command, self._output = wheel_radius_m, wheels, command, output
        self.reads, self.writes = (wheels, command), (output,)
        self.state: DelayMemory = DelayMemory("/ugv/state/delay")
        self._estimator = DelayEstimator(config, answer, self.state.learnt)
        self._estimator.forget()

    def step(self, now_ns: int) -> None:
        """One estimate; see `Task`."""
        wheels, command, estimator = self._wheels, self._command, self._estimator
        if command.enable and wheels.enabled:
            sent = centre_angle(command.steering), rolling_speed(command.speed, self._radius_m)
            done = centre_angle(wheels.steering), rolling_speed(wheels.speed, self._radius_m)
            estimator.add(command.stamp_ns * 1e-9, sent[1], sent[0])
            estimator.step(now_ns * 1e-9, *done)
        else:
            estimator.pause()
        self._output.stamp_ns, self._output.delay = now_ns, estimator.delay_s
