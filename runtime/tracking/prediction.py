# SPDX-License-Identifier: Apache-2.0
"""Where the vehicle will be when a command that is given now reaches its wheels.

Until then it does what the commands ask that are on their way. Steering from the predicted pose takes the delay out of
the loop (a Smith predictor); what is left of it is the error of the prediction.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.tracking.motion import Motion
from runtime.tracking.vehicle_answer import VehicleAnswer

Array = npt.NDArray[np.float64]

CAPACITY = 80
"""Commands that are remembered: 1.6 s at 50 Hz."""
FIELDS = 3
STEP_S = 0.02


class CommandHistory:
    """The last commands, oldest first.

    Args:
        memory: `CommandHistory.SIZE` numbers, zeros at first; all that is remembered.
    """

    SIZE = CAPACITY * FIELDS

    def __init__(self, memory: Array) -> None:
        self._memory = memory
        self._rows = memory.reshape(CAPACITY, FIELDS)

    def add(self, time_s: float, speed: float, angle: float) -> None:
        """Remember a command (m/s and centre angle in rad) that was given at a time, which is positive."""
        self._memory[:-FIELDS] = self._memory[FIELDS:]
        self._memory[-FIELDS:] = time_s, speed, angle

    def predicted(self, motion: Motion, now_s: float, delay_s: float, answer: VehicleAnswer) -> Motion:
        """The motion when a command of now takes effect.

        Args:
            motion: now.
            now_s: time.
            delay_s: from a command to the wheels.
            answer: of the vehicle, the delay apart.
        """
        limits = (answer.wheelbase_m, answer.rate_radps, answer.lag_s, answer.acceleration_mps2)
        x, y, yaw, speed, angle, yaw_rate = map(float, motion)
        return Motion(*_predict(self._rows, now_s, delay_s, (x, y, yaw, speed, angle, yaw_rate), limits))


@compiled
def _predict(
    commands: Array,
    now_s: float,
    delay_s: float,
    motion: tuple[float, float, float, float, float, float],
    answer: tuple[float, float, float, float],
) -> tuple[float, float, float, float, float, float]:
    """The motion after the commands that are on their way; what is not known holds."""
    x, y, yaw, speed, angle, yaw_rate = motion
    wheelbase, rate, lag, acceleration = answer
    for row in range(commands.shape[0]):
        begin = commands[row, 0]
        end = commands[row + 1, 0] if row + 1 < commands.shape[0] else now_s
        duration = min(end, now_s) - max(begin, now_s - delay_s)
        if begin <= 0.0 or duration <= 0.0:
            continue
        steps = int(duration / STEP_S) + 1
        time = duration / steps
        for _ in range(steps):
            change = commands[row, 2] - angle
            if lag > 0.0:
                change *= 1.0 - math.exp(-time / lag)
            change = min(max(change, -rate * time), rate * time)
            gain = min(max(commands[row, 1] - speed, -acceleration * time), acceleration * time)
            yaw_rate = 2.0 * (speed + 0.5 * gain) * math.tan(angle + 0.5 * change) / wheelbase
            middle = yaw + 0.5 * yaw_rate * time
            way = (speed + 0.5 * gain) * time
            x, y, yaw = x + way * math.cos(middle), y + way * math.sin(middle), yaw + yaw_rate * time
            angle, speed = angle + change, speed + gain
    return x, y, yaw, speed, angle, yaw_rate
