# SPDX-License-Identifier: Apache-2.0
"""What the legs do when no plan comes any more: they share the weight, with the trunk above the middle of the feet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.compiled import compiled
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import yaw_of_quaternion
from runtime.records import Record, boolean, float64
from runtime.signals import BodyState, ContactForces


class StandingMemory(Record):
    """Where to stand."""

    unplanned = boolean("no plan has come for too long")
    x = float64("m", "middle of the feet, in odom")
    y = float64("m")
    yaw = float64("rad")


@compiled
def take_place(memories: Sequence[StandingMemory], bodies: Sequence[BodyState]) -> None:
    """Remember where the robot has come to stand."""
    memory, body = memories[0], bodies[0]
    memory.x, memory.y = float(np.mean(body.foot_position[0::3])), float(np.mean(body.foot_position[1::3]))
    memory.yaw = yaw_of_quaternion(body.orientation)


@compiled
def stand(memories: Sequence[StandingMemory], plans: Sequence[ContactForces], mass_kg: float, now_ns: int) -> None:
    """Make a plan of standing there of the last plan, whose height and tilt it keeps."""
    memory, plan = memories[0], plans[0]
    plan.stamp_ns = now_ns
    plan.knot_ns[:] = now_ns
    plan.stance[:] = 1
    plan.force[:] = 0.0
    plan.force[2::3] = mass_kg * GRAVITY / 4
    plan.reference_position[0], plan.reference_position[1] = memory.x, memory.y
    plan.reference_velocity[:] = 0.0
    plan.reference_orientation[2] = memory.yaw
    plan.reference_yaw_rate = 0.0
