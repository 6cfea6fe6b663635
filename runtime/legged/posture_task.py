# SPDX-License-Identifier: Apache-2.0
"""Stands the robot up and sits it down."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.legged.posture import PostureConfig, blend
from runtime.models.quadruped import Quadruped
from runtime.records import Record, boolean, float64, float64_array, int64, uint8
from runtime.signals import JointState, Mode, Motion, OperatorRequest, Posture, SafetyStatus, Stance
from runtime.tasks import Task

Array = npt.NDArray[np.float64]

UPRIGHT_TOLERANCE_RAD = 0.25
"""Joints this close to the standing posture need no standing up, only a short settling."""
SEATED_TOLERANCE_RAD = 0.2
"""Joints this close to the seated posture can lift the trunk at once."""
SHORTEST_FRACTION = 0.2
"""Shortest motion, as a part of the full one."""


class PostureMemory(Record):
    """What the posture must remember."""

    stance = uint8()
    crouching = boolean()
    begin = float64_array("joint", "rad")
    begin_ns = int64("ns")
    duration_s = float64("s")


class Postures(NamedTuple):
    """Joint angles (12,) of the postures between which the robot moves."""

    upright: Array
    seated: Array
    crouched: Array


class PostureTask(Task):
    """Moves the joints between resting and standing when the operator asks and safety allows, or crouches for safety.

    Legs that lie as a fall has left them would push the trunk over: they are gathered below it before it rises.

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
        self.reads, self.writes = (joints, operator, safety), (output,)
        self.state: PostureMemory = PostureMemory("/ugv/state/posture", output.sizes)
        heights = config.height_m, config.sitting_height_m, config.crouching_height_m
        self._move = partial(
            _move,
            table_of(config),
            Postures(*(description.standing_angles(height) for height in heights)),
            joints.table,
            operator.table,
            safety.table,
            self.state.table,
            output.table,
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        self._move(now_ns)


@compiled
def _move(
    configs: Sequence[PostureConfig],
    postures: Postures,
    all_joints: Sequence[JointState],
    operators: Sequence[OperatorRequest],
    statuses: Sequence[SafetyStatus],
    memories: Sequence[PostureMemory],
    outputs: Sequence[Posture],
    now_ns: int,
) -> None:
    """Begin a motion where one is asked for, and go on with the present one."""
    config, joints, memory, output = configs[0], all_joints[0], memories[0], outputs[0]
    mode, motion = statuses[0].mode, operators[0].motion
    up = motion == Motion.STAND or motion == Motion.WALK
    if mode == Mode.CROUCHING:
        if not memory.crouching:
            memory.crouching = True
            _begin(config, memory, joints, Stance.SITTING.value, postures.crouched, now_ns)
            memory.duration_s = config.crouch_s
    elif mode != Mode.STANDING and mode != Mode.ACTIVE:
        memory.stance, memory.crouching = Stance.RESTING.value, False
    elif up and memory.stance == Stance.RESTING and not can_rise(joints.position, postures):
        _begin(config, memory, joints, Stance.GATHERING.value, postures.seated, now_ns)
    elif up and (memory.stance == Stance.RESTING or memory.stance == Stance.SITTING):
        _begin(config, memory, joints, Stance.RISING.value, postures.upright, now_ns)
    elif not up and mode == Mode.STANDING and is_up(memory.stance):
        _begin(config, memory, joints, Stance.SITTING.value, postures.seated, now_ns)
    target = postures.upright if is_up(memory.stance) else postures.seated
    if memory.crouching:
        target = postures.crouched
    progress = 1.0
    if is_moving(memory.stance):
        progress = (now_ns - memory.begin_ns) * 1e-9 / memory.duration_s
        position, rate = blend(memory.begin, target, progress)
        output.position[:], output.velocity[:] = position, rate / memory.duration_s
        if progress >= 1.0 and memory.stance == Stance.GATHERING and up:
            _begin(config, memory, joints, Stance.RISING.value, postures.upright, now_ns)
        elif progress >= 1.0:
            memory.stance = (Stance.STANDING if memory.stance == Stance.RISING else Stance.RESTING).value
    else:
        output.position[:], output.velocity[:] = target, 0.0
    output.stamp_ns = now_ns
    output.stance = memory.stance
    output.progress = min(progress, 1.0)


@compiled
def can_rise(position: Array, postures: Postures) -> bool:
    """Whether the legs (12,) are below the trunk, seated or upright."""
    seated = np.abs(position - postures.seated).max() <= SEATED_TOLERANCE_RAD
    return bool(seated or np.abs(position - postures.upright).max() <= UPRIGHT_TOLERANCE_RAD)


@compiled
def is_moving(stance: int) -> bool:
    """Whether the legs are on their way to a posture."""
    return stance == Stance.RISING or stance == Stance.SITTING or stance == Stance.GATHERING


@compiled
def is_up(stance: int) -> bool:
    """Whether the legs stand, or are on their way to it."""
    return stance == Stance.RISING or stance == Stance.STANDING


@compiled
def _begin(
    config: PostureConfig, memory: PostureMemory, joints: JointState, stance: int, target: Array, now_ns: int
) -> None:
    """Set out for a posture from wherever the joints are."""
    memory.stance, memory.begin_ns = stance, now_ns
    memory.begin[:] = joints.position
    distance = np.abs(target - memory.begin).max() / UPRIGHT_TOLERANCE_RAD
    memory.duration_s = config.rise_s * min(1.0, max(SHORTEST_FRACTION, distance))
