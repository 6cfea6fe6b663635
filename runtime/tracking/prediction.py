# SPDX-License-Identifier: Apache-2.0
"""Where the vehicle will be when a command that is given now reaches its wheels.

Until then it does what the commands ask that are on their way. Steering from the predicted pose takes the delay out of
the loop (a Smith predictor); what is left of it is the error of the prediction.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.tracking.motion import Motion
from runtime.tracking.vehicle_answer import VehicleAnswer

Array = npt.NDArray[np.float64]

CAPACITY = 80
"""Commands that are remembered: 1.6 s at 50 Hz."""
FIELDS = 3
LONGEST_STEP_S = 0.04


class CommandHistory:
    """The last commands, oldest first.

    Args:
        memory: one-dimensional, at least `CommandHistory.SIZE` zeros; all that is remembered.
    """

    SIZE = CAPACITY * FIELDS

    def __init__(self, memory: Array) -> None:
        self._memory = memory

    def add(self, time_s: float, speed: float, angle: float) -> None:
        """Remember a command (m/s and centre angle in rad) that was given at a time."""
        self._memory[:-FIELDS] = self._memory[FIELDS:]
        self._memory[-FIELDS:] = time_s, speed, angle

    def clear(self) -> None:
        """Forget all."""
        self._memory[:] = 0.0

    def between(self, start_s: float, end_s: float) -> list[tuple[float, float, float]]:
        """What was asked for between two times: (duration in s, speed, angle), in order.

        A command holds until the next. Times from before the first one are left out.
        """
        values = self._memory.tolist()
        asked: list[tuple[float, float, float]] = []
        until = end_s
        for i in range(len(values) - FIELDS, -1, -FIELDS):
            time, speed, angle = values[i : i + FIELDS]
            if time <= 0.0 or until <= start_s:
                break
            if time < until:
                asked.append((until - max(time, start_s), speed, angle))
                until = time
        asked.reverse()
        return asked


def predicted(motion: Motion, asked: list[tuple[float, float, float]], answer: VehicleAnswer) -> Motion:
    """The motion after the wheels have done what was asked.

    Args:
        motion: now.
        asked: see `CommandHistory.between`.
        answer: of the steering.
    """
    for duration, speed, wanted in asked:
        steps = int(duration / LONGEST_STEP_S) + 1
        time = duration / steps
        for _ in range(steps):
            angle = answer.answered(motion.angle, wanted, time)
            reached = answer.reached(motion.speed, speed, time)
            middle = 0.5 * (motion.angle + angle), 0.5 * (motion.speed + reached)
            motion = motion.advanced(time, *middle, answer.wheelbase_m)._replace(angle=angle, speed=reached)
    return motion
