# SPDX-License-Identifier: Apache-2.0
"""Stands the robot up and sits it down."""

from __future__ import annotations

import numpy as np

from runtime.legged.posture import PostureConfig, blend
from runtime.models.quadruped import Quadruped
from runtime.records import Record, boolean, float64, float64_array, int64, uint8
from runtime.signals import JointState, Mode, Motion, OperatorRequest, Posture, SafetyStatus, Stance
from runtime.tasks import Task

UPRIGHT_TOLERANCE_RAD = 0.25
"""Joints this close to the standing posture need no standing up, only a short settling."""
SHORTEST_FRACTION = 0.2
"""Shortest motion, as a part of the full one."""


class PostureMemory(Record):
    """What the posture must remember."""

    stance = uint8()
    crouching = boolean()
    begin = float64_array("joint", "rad")
    begin_ns = int64("ns")
    duration_s = float64("s")


class PostureTask(Task):
    """Moves the joints between resting and standing when the operator asks and safety allows, or crouches for safety.

    Args:
        description: of the robot.
        config: heights and durations.
        joints, operator, safety: records read; `safety` is that of the tick before.
        output: record written.
    """

    name = "posture"

    def __init__(
        self,
        description: Quadruped,
        config: PostureConfig,
        joints: JointState,
        operator: OperatorRequest,
        safety: SafetyStatus,
        output: Posture,
    ) -> None:
        self._config = config
        self._joints, self._operator, self._safety, self._output = joints, operator, safety, output
        self._upright = description.standing_angles(config.height_m)
        self._seated = description.standing_angles(config.sitting_height_m)
        self._crouched = description.standing_angles(config.crouching_height_m)
        self.reads, self.writes = (joints, operator, safety), (output,)
        self.state: PostureMemory = PostureMemory("/ugv/state/posture", output.sizes)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, output = self.state, self._output
        mode = self._safety.mode
        up = self._operator.motion in (Motion.STAND, Motion.WALK)
        if mode == Mode.CROUCHING:
            self._crouch(now_ns)
        elif mode not in (Mode.STANDING, Mode.ACTIVE):
            memory.stance, memory.crouching = Stance.RESTING, False
        elif up and memory.stance in (Stance.RESTING, Stance.SITTING):
            self._begin(Stance.RISING, self._upright, now_ns)
        elif not up and mode == Mode.STANDING and memory.stance in (Stance.RISING, Stance.STANDING):
            self._begin(Stance.SITTING, self._seated, now_ns)
        target = self._upright if memory.stance in (Stance.RISING, Stance.STANDING) else self._seated
        if memory.crouching:
            target = self._crouched
        if memory.stance in (Stance.RISING, Stance.SITTING):
            progress = (now_ns - memory.begin_ns) * 1e-9 / memory.duration_s
            output.position, rate = blend(memory.begin, target, progress)
            output.velocity = rate / memory.duration_s
            if progress >= 1.0:
                memory.stance = Stance.STANDING if memory.stance == Stance.RISING else Stance.RESTING
        else:
            progress = 1.0
            output.position, output.velocity = target, 0.0
        output.stamp_ns = now_ns
        output.stance = memory.stance
        output.progress = min(progress, 1.0)

    def _crouch(self, now_ns: int) -> None:
        """Go down from wherever the joints are."""
        if not self.state.crouching:
            self.state.crouching = True
            self._begin(Stance.SITTING, self._crouched, now_ns)
            self.state.duration_s = self._config.crouch_s

    def _begin(self, stance: Stance, target: np.ndarray, now_ns: int) -> None:
        memory = self.state
        memory.stance, memory.begin, memory.begin_ns = stance, self._joints.position, now_ns
        distance = float(np.abs(target - memory.begin).max()) / UPRIGHT_TOLERANCE_RAD
        memory.duration_s = self._config.rise_s * min(1.0, max(SHORTEST_FRACTION, distance))
