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
    spin = rotation @ output.angular_velocity
    levers = legs.position @ rotation.T
    feet = output.position + levers
    output.foot_position = feet.ravel()
    output.foot_velocity = (output.linear_velocity + legs.velocity @ rotation.T + levers @ skew(spin).T).ravel()
    stood = memory.stood.reshape(4, 3)
    if not memory.standing_known:
        memory.standing_known = True
        stood[:] = feet
        memory.normal = plane_normal(stood)
        memory.course_velocity = output.linear_velocity[:2]
    stood[contact] = feet[contact]
    memory.normal = smoothed(memory.normal, plane_normal(stood), plane_gain)
    memory.course_velocity += course_gain * (output.linear_velocity[:2] - memory.course_velocity)
    output.contact = contact
    output.plane_normal = memory.normal
    output.height = height_above(output.position, stood, memory.normal, foot_radius)
    output.course_velocity = memory.course_velocity
