# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.tracking.motion import Motion
from runtime.tracking.prediction import CommandHistory
from runtime.tracking.vehicle_answer import VehicleAnswer

ANSWER = VehicleAnswer(lag_s=0.1)
PERIOD = 0.02


def history():
    return CommandHistory(np.zeros(CommandHistory.SIZE))


def driven(answering, commands, answer, motion, step=0.001):
    """The same vehicle in small steps of Euler."""
    x, y, yaw, speed, angle, _ = motion
    for wanted_speed, wanted in commands:
        for _ in range(round(PERIOD / step)):
            angle = answering.angle(answer, angle, wanted, step)
            speed = answering.speed(answer, speed, wanted_speed, step)
            yaw += step * 2.0 * speed * math.tan(angle) / answer.wheelbase_m
            x, y = x + step * speed * math.cos(yaw), y + step * speed * math.sin(yaw)
    return x, y, yaw, speed, angle


commands = st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-0.6, 0.6)), min_size=1, max_size=30)


@settings(max_examples=40, deadline=None)
@given(commands, st.floats(-1.0, 2.0), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0))
def test_what_was_asked_within_the_delay_is_done(answering, asked, speed, angle, yaw):
    late, now = history(), 10.0
    late.add(5.0, -9.0, 9.0)  # long done
    for index, (wanted_speed, wanted) in enumerate(asked):
        late.add(now - PERIOD * (len(asked) - index), wanted_speed, wanted)
    motion = Motion(1.0, 2.0, yaw, speed, angle)
    there = late.predicted(motion, now, PERIOD * len(asked), ANSWER)
    assert there[:5] == pytest.approx(driven(answering, asked, ANSWER, motion), abs=0.02)


def test_a_command_that_began_before_the_delay_counts_for_the_rest_of_its_time():
    late = history()
    late.add(1.0, 1.0, 0.0)
    there = late.predicted(Motion(0.0, 0.0, 0.0, 1.0), 3.0, 0.5, ANSWER)
    assert there[:3] == pytest.approx((0.5, 0.0, 0.0))


def test_without_commands_or_delay_nothing_is_predicted():
    motion = Motion(1.0, 2.0, 0.3, 0.6, 0.1, 0.2)
    late = history()
    assert late.predicted(motion, 3.0, 0.6, ANSWER) == motion
    late.add(2.9, 1.0, 0.5)
    assert late.predicted(motion, 3.0, 0.0, ANSWER) == motion


def test_the_oldest_are_forgotten():
    late = history()
    for index in range(200):
        late.add(1.0 + 0.02 * index, 1.0, 0.0)
    far = late.predicted(Motion(0.0, 0.0, 0.0, 1.0), 5.0, 5.0, ANSWER)
    assert far.x == pytest.approx(80 * 0.02)


def test_looking_back_is_its_own_inverse():
    motion = Motion(1.0, 2.0, 0.3, 0.6, 0.1, 0.2)
    assert motion.reversed().reversed() == pytest.approx(motion)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(0.001, 5.0))
def test_slewing_reaches_the_wanted_curvature_no_faster_than_the_steering(present, wanted, time_s):
    answer = VehicleAnswer()
    reached = answer.slewed(present, wanted, time_s)
    change = abs(answer.angle_of(reached) - answer.angle_of(present))
    assert change <= answer.rate_radps * time_s + 1e-12
    assert min(present, wanted) - 1e-12 <= reached <= max(present, wanted) + 1e-12
    if abs(answer.angle_of(wanted) - answer.angle_of(present)) <= answer.rate_radps * time_s:
        assert reached == wanted
