# SPDX-License-Identifier: Apache-2.0
"""What every estimator derives from the trunk's pose and twist: feet, stance plane, height and course."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.estimation.stance_plane import height_above, plane_normal, smoothed
from runtime.models.leg_kinematics import LegState
from runtime.models.vectors import skew
from runtime.records import Record, boolean, float64_array
from runtime.signals import BodyState

Array = npt.NDArray[np.float64]


class StanceMemory(Record):
    """What the stance plane and the course must remember."""

    standing_known = boolean()
    stood = float64_array("foot_xyz", "m", "where each foot last stood (centre), in odom")
    normal = float64_array(3, "", "smoothed normal of the stance plane")
    course_velocity = float64_array(2, "m/s")


def complete(
    output: BodyState,
    memory: StanceMemory,
    legs: LegState,
    rotation: Array,
    contact: npt.NDArray[np.bool_],
    foot_radius: float,
    plane_gain: float,
    course_gain: float,
) -> None:
    """Fill the derived fields of `output`, whose pose and twist are set, and keep `memory` up to date."""
    spin = skew(output.angular_velocity)
    feet = output.foot_position.reshape(4, 3)
    feet[:] = legs.position @ rotation.T + output.position
    moving = legs.velocity - legs.position @ spin
    output.foot_velocity.reshape(4, 3)[:] = moving @ rotation.T + output.linear_velocity
    stood = memory.stood.reshape(4, 3)
    velocity = output.linear_velocity[:2]
    if not memory.standing_known:
        memory.standing_known = True
        stood[:] = feet
        memory.normal = plane_normal(stood.tolist())
        memory.course_velocity = velocity
    stood[contact] = feet[contact]
    points = stood.tolist()
    normal = smoothed(memory.normal.tolist(), plane_normal(points), plane_gain)
    memory.normal = output.plane_normal = normal
    memory.course_velocity += course_gain * (velocity - memory.course_velocity)
    output.course_velocity = memory.course_velocity
    output.contact = contact
    output.height = height_above(output.position.tolist(), points, normal, foot_radius)
