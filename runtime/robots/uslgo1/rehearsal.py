# SPDX-License-Identifier: Apache-2.0
"""USLGO1 walks a few steps in thought, so that what is compiled or loaded at first use is there before it counts.

The loops are stepped on made-up inputs: the joints stand still in the standing posture, the IMU feels gravity, and the
operator has the robot stand up and walk, on ground so slippery that the forces meet their bounds, or what searches
among these would first be used when it counts. Then it has to do without plans, and without the IMU: the answers to
faults are rehearsed as well. No frame leaves, and nothing that the real loops remember is touched.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from runtime.models.rigid_body import GRAVITY
from runtime.records import Record
from runtime.robots.uslgo1.assembly import assemble
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import (
    Battery,
    Imu,
    JointState,
    Mode,
    Motion,
    OperatorRequest,
    Path,
    Pose,
    SafetyStatus,
    Steering,
    Truth,
)
from runtime.tasks import Loop, due

BEGIN_NS = 1_000_000_000
SPEED_MPS, GOAL_M = 0.3, 10.0
VELOCITY = (0.2, 0.0, 0.2)
"""Forward and lateral, m/s, and yaw rate, rad/s."""
SLIPPERY = 0.02
"""Friction coefficient."""


class _Part(NamedTuple):
    """A part of the rehearsal.

    Attributes:
        until_ns: when it ends.
        motion, steering: that the operator asks for.
        plans: whether the slow loop is stepped.
        feels: whether the IMU speaks.
    """

    until_ns: int
    motion: Motion
    steering: Steering = Steering.PATH
    plans: bool = True
    feels: bool = True


PARTS = (
    _Part(600_000_000, Motion.STAND),  # a robot that stands already is ready by then
    _Part(1_200_000_000, Motion.WALK),  # steps with every leg
    _Part(1_400_000_000, Motion.WALK, Steering.VELOCITY),
    _Part(1_900_000_000, Motion.STAND, plans=False),  # comes to a stand, and then has no plan
    _Part(2_100_000_000, Motion.STAND),
    _Part(2_800_000_000, Motion.STAND, feels=False),  # crouches, and is damped
)


def rehearse(config: Uslgo1Config) -> bool:
    """Step every loop for a while in virtual time; true if the robot came to walk, and in the end was damped."""
    relaxation = replace(config.whole_body.relaxation, friction=SLIPPERY)
    whole_body = replace(config.whole_body, relaxation=relaxation)
    loops = assemble(replace(config, whole_body=whole_body)).loops
    scene = _Scene(config)
    written = {record.topic: record for loop in loops for record in loop.writes}
    (status,) = (record for record in written.values() if isinstance(record, SafetyStatus))
    fast, modes, elapsed_ns = loops[0], set(), 0
    for part in PARTS:
        scene.part = part
        while elapsed_ns < part.until_ns:
            for loop in loops:
                if elapsed_ns % loop.period_ns == 0 and (loop is fast or part.plans):
                    _step(loop, elapsed_ns // loop.period_ns, elapsed_ns, scene, written)
            modes.add(Mode(status.mode))
            elapsed_ns += fast.period_ns
    return {Mode.ACTIVE, Mode.CROUCHING, Mode.DAMPED} <= modes


def _step(loop: Loop, index: int, elapsed_ns: int, scene: _Scene, written: dict[str, Record]) -> None:
    for record in loop.port_inputs:
        scene.show(record, elapsed_ns)
    for record in loop.receives:
        record.copy_from(written[record.topic])
    for item in loop.schedule:
        if due(item, index):
            item.task.step(BEGIN_NS + elapsed_ns)
            for record in item.task.writes:
                scene.show(record, elapsed_ns)


class _Scene:
    """What the robot is made to believe.

    Attributes:
        part: of the rehearsal.
    """

    def __init__(self, config: Uslgo1Config) -> None:
        self.part = PARTS[0]
        self._angles = config.quadruped.standing_angles(config.posture.height_m)
        self._height_m = config.posture.height_m
        self._voltage_v = 0.5 * (config.safety.voltage_min_v + config.safety.voltage_max_v)

    def show(self, record: Record, elapsed_ns: int) -> None:
        """Fill a record that shows the world; any other stays as it is."""
        now_ns = BEGIN_NS + elapsed_ns
        if isinstance(record, JointState):
            record.stamp_ns, record.reply_ns, record.error = now_ns, now_ns, 0
            record.position, record.velocity, record.effort = self._angles, 0.0, 0.0
        elif isinstance(record, Imu) and self.part.feels:
            record.stamp_ns, record.sequence = now_ns, elapsed_ns
            record.linear_acceleration, record.angular_velocity = (0.0, 0.0, GRAVITY), 1e-12 * elapsed_ns
        elif isinstance(record, (Pose, Truth)):
            record.stamp_ns, record.position = now_ns, (0.0, 0.0, self._height_m)
            record.orientation = (0.0, 0.0, 0.0, 1.0)
            if isinstance(record, Pose):
                record.sequence = 1 + elapsed_ns
        elif isinstance(record, Battery):
            record.stamp_ns, record.voltage = now_ns, self._voltage_v
        elif isinstance(record, Path):
            record.stamp_ns, record.count, record.speed = BEGIN_NS, 2, SPEED_MPS
            record.x[:2] = np.array([0.0, GOAL_M])
        elif isinstance(record, OperatorRequest):
            record.stamp_ns, record.held, record.arm = now_ns, True, elapsed_ns > 0
            record.motion, record.steering = self.part.motion, self.part.steering
            record.velocity, record.velocity_ns = VELOCITY, now_ns
