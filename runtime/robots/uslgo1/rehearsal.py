# SPDX-License-Identifier: Apache-2.0
"""USLGO1 walks a few steps in thought, so that what is compiled or loaded at first use is there before it counts.

The loops are stepped on made-up inputs: the joints stand still in the standing posture, the IMU feels gravity, and the
operator has the robot stand up and walk, on ground so slippery that the forces meet their bounds, or what searches
among these would first be used when it counts. No frame leaves, and nothing that the real loops remember is touched.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from runtime.models.rigid_body import GRAVITY
from runtime.records import Record
from runtime.robots.uslgo1.assembly import assemble
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Battery, Imu, JointState, Mode, Motion, OperatorRequest, Path, Pose, SafetyStatus, Truth
from runtime.tasks import Loop, due

BEGIN_NS = 1_000_000_000
WALK_AFTER_NS, DURATION_NS = 600_000_000, 1_200_000_000
"""A robot that stands already is ready by then, and has taken steps with every leg by then."""
SPEED_MPS, GOAL_M = 0.3, 10.0
SLIPPERY = 0.02
"""Friction coefficient."""


def rehearse(config: Uslgo1Config) -> bool:
    """Step every loop for a while in virtual time; true if the robot came to walk."""
    relaxation = replace(config.whole_body.relaxation, friction=SLIPPERY)
    whole_body = replace(config.whole_body, relaxation=relaxation)
    loops = assemble(replace(config, whole_body=whole_body)).loops
    scene = _Scene(config)
    written = {record.topic: record for loop in loops for record in loop.writes}
    modes = [record for record in written.values() if isinstance(record, SafetyStatus)]
    walked = False
    fast = loops[0]
    for index in range(DURATION_NS // fast.period_ns):
        elapsed_ns = index * fast.period_ns
        for loop in loops:
            if elapsed_ns % loop.period_ns == 0:
                _step(loop, elapsed_ns // loop.period_ns, elapsed_ns, scene, written)
        walked = walked or modes[0].mode == Mode.ACTIVE
    return walked


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
    """What the robot is made to believe."""

    def __init__(self, config: Uslgo1Config) -> None:
        self._angles = config.quadruped.standing_angles(config.posture.height_m)
        self._height_m = config.posture.height_m
        self._voltage_v = 0.5 * (config.safety.voltage_min_v + config.safety.voltage_max_v)

    def show(self, record: Record, elapsed_ns: int) -> None:
        """Fill a record that shows the world; any other stays as it is."""
        now_ns = BEGIN_NS + elapsed_ns
        if isinstance(record, JointState):
            record.stamp_ns, record.reply_ns, record.error = now_ns, now_ns, 0
            record.position, record.velocity, record.effort = self._angles, 0.0, 0.0
        elif isinstance(record, Imu):
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
            record.motion = Motion.WALK if elapsed_ns >= WALK_AFTER_NS else Motion.STAND
