# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.tracking.bends import CURVE_RADIUS_M
from runtime.tracking.motion import Motion
from runtime.tracking.paths import circle, straight
from runtime.tracking.polyline import Polyline
from runtime.tracking.steered_return import SteeredReturn
from runtime.tracking.vehicle_answer import VehicleAnswer

LINE = Polyline(straight(60.0))
LAW = SteeredReturn()

offsets, headings, angles = st.floats(-3.0, 3.0), st.floats(-1.2, 1.2), st.floats(-0.5, 0.5)


def asked(x, y, yaw, speed=0.6, angle=0.0, path=LINE):
    return LAW(path, Motion(x, y, yaw, speed, angle), path.closest(x, y, 0.0, 60.0)).curvature


@given(offsets, headings, angles, st.floats(0.0, 3.0))
def test_is_odd_and_bounded(lateral, heading, angle, speed):
    curvature = asked(10.0, lateral, heading, speed, angle)
    assert curvature == pytest.approx(-asked(10.0, -lateral, -heading, speed, -angle), abs=1e-9)
    assert abs(curvature) <= LAW.maximum_curvature * (1.0 + 1e-9)


def test_on_the_path_it_asks_for_the_paths_own_curvature():
    assert asked(10.0, 0.0, 0.0) == 0.0
    ring = Polyline(circle(CURVE_RADIUS_M, 0.1), closed=True)
    angle = VehicleAnswer().angle_of(1.0 / CURVE_RADIUS_M)
    x, y = ring.point(5.0)
    assert asked(x, y, ring.heading(5.0), 0.6, angle, ring) == pytest.approx(0.4, abs=0.02)


@given(st.floats(0.05, 3.0), st.floats(0.2, 3.0))
def test_heads_for_the_path_no_steeper_than_it_may(lateral, speed):
    steep, slope = LAW._descent(lateral, speed)
    assert 0.0 < steep <= LAW.steepest_rad
    assert slope >= 0.0
    flatter, _ = LAW._descent(0.9 * lateral, speed)
    assert flatter <= steep


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-2.0, 2.0),
    st.floats(-0.8, 0.8),
    st.floats(0.4, 2.5),
    st.floats(math.radians(10.0), math.radians(60.0)),
)
def test_comes_back_to_the_path_from_anywhere(answering, lateral, heading, speed, rate):
    answer, step = VehicleAnswer(rate_radps=rate), 0.02
    law = SteeredReturn(answer=answer)
    motion, travelled = Motion(1.0, lateral, heading, speed, 0.0), 0.0
    errors = []
    for _ in range(round(25.0 / step)):
        closest = LINE.closest(motion.x, motion.y, travelled, 3.0, beyond_goal=True)
        travelled = closest.progress
        wanted = answer.angle_of(law(LINE, motion, closest).curvature)
        angle = answering.angle(answer, motion.angle, wanted, step)
        yaw = motion.yaw + step * speed * answer.curvature_of(angle)
        x, y = motion.x + step * speed * math.cos(yaw), motion.y + step * speed * math.sin(yaw)
        motion = Motion(x, y, yaw, speed, angle)
        errors.append(abs(motion.y))
        if motion.x > 58.0:
            break
    assert np.max(errors[-5:]) <= 0.02
    assert abs(motion.yaw) <= 0.05
