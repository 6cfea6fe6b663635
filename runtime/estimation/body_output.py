# SPDX-License-Identifier: Apache-2.0
"""What every estimator derives from the trunk's pose and twist: feet, stance plane, height and course."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.estimation.inertial_input import StepMemory
from runtime.estimation.stance_plane import height_above, plane_normal, smoothed
from runtime.models.leg_kinematics import LegState
from runtime.models.vectors import cross, turned
from runtime.records import boolean, float64_array
from runtime.signals import BodyState

Array = npt.NDArray[np.float64]


class StanceMemory(StepMemory):
    """What the stance plane and the course must remember."""

    standing_known = boolean()
    stood = float64_array("foot_xyz", "m", "where each foot last stood (centre), in odom")
    normal = float64_array(3, "", "smoothed normal of the stance plane")
    course_velocity = float64_array(2, "m/s")


@compiled
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
    first, memory.standing_known = not memory.standing_known, True
    for foot in range(4):
        xyz = slice(3 * foot, 3 * foot + 3)
        relative = legs.velocity[foot] + cross(output.angular_velocity, legs.position[foot])
        output.foot_position[xyz] = output.position + turned(rotation, legs.position[foot])
        output.foot_velocity[xyz] = output.linear_velocity + turned(rotation, relative)
        if contact[foot] or first:
            memory.stood[xyz] = output.foot_position[xyz]
    points = memory.stood.reshape(4, 3)
    measured = plane_normal(points)
    if first:
        memory.normal[:] = measured
        memory.course_velocity[:] = output.linear_velocity[:2]
    memory.normal[:] = smoothed(memory.normal, measured, plane_gain)
    memory.course_velocity += course_gain * (output.linear_velocity[:2] - memory.course_velocity)
    output.plane_normal[:] = memory.normal
    output.course_velocity[:] = memory.course_velocity
    output.contact[:] = contact
    output.height = height_above(output.position, points, memory.normal, foot_radius)
