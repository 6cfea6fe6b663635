# SPDX-License-Identifier: Apache-2.0
"""Standing up and sitting down are smooth, and only happen under power."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.legged.posture import blend
from runtime.legged.posture_task import PostureTask
from runtime.signals import Mode, Motion, Stance

MS = 1_000_000


@given(st.floats(-1.0, 2.0))
def test_blending_stays_between_its_ends_and_has_its_rate(progress):
    begin, end = np.array([0.3, -1.0]), np.array([-0.7, 2.0])
    position, rate = blend(begin, end, progress)
    assert (position >= np.minimum(begin, end) - 1e-12).all()
    assert (position <= np.maximum(begin, end) + 1e-12).all()
    if 1e-4 < progress < 1 - 1e-4:
        slope = (blend(begin, end, progress + 1e-6)[0] - blend(begin, end, progress - 1e-6)[0]) / 2e-6
        np.testing.assert_allclose(rate, slope, atol=1e-5)


@pytest.mark.parametrize(("progress", "index"), [(0.0, 0), (1.0, 1), (-3.0, 0), (4.0, 1)])
def test_blending_begins_and_ends_at_rest(progress, index):
    ends = np.array([0.3, -1.0]), np.array([-0.7, 2.0])
    position, rate = blend(*ends, progress)
    np.testing.assert_allclose(position, ends[index], atol=1e-12)
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)


class Rig:
    """A robot whose joints follow at once."""

    def __init__(self, robot, height=None):
        self.robot = robot
        config = robot.config
        self.seated = robot.robot.standing_angles(config.posture.sitting_height_m)
        self.upright = robot.robot.standing_angles(config.posture.height_m)
        robot.joints.position = self.seated
        robot.safety.mode = Mode.STANDBY
        self.task = PostureTask(robot.robot, config.posture, robot.joints, robot.operator, robot.safety, robot.posture)
        self.now_ns = 0

    def run(self, seconds):
        trace = []
        for _ in range(int(seconds * 500)):
            self.task.step(self.now_ns)
            self.robot.joints.position = self.robot.posture.position
            trace.append(self.robot.posture.position.copy())
            self.now_ns += 2 * MS
        return np.array(trace)


def test_it_stands_up_and_sits_down_smoothly(bench):
    rig = Rig(bench())
    rig.run(0.1)
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.STAND, Mode.STANDING
    rise = rig.run(1.6)
    assert rig.robot.posture.stance == Stance.STANDING
    np.testing.assert_allclose(rise[-1], rig.upright, atol=1e-9)
    np.testing.assert_allclose(rise[0], rig.seated, atol=1e-9)
    assert np.abs(np.diff(rise, 2, axis=0)).max() < 1e-3
    rig.robot.operator.motion = Motion.SIT
    sit = rig.run(1.6)
    assert rig.robot.posture.stance == Stance.RESTING
    np.testing.assert_allclose(sit[-1], rig.seated, atol=1e-9)


def test_reference_velocity_is_the_derivative_of_the_reference(bench):
    rig = Rig(bench())
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.STAND, Mode.STANDING
    rig.run(0.5)
    before = rig.robot.posture.position.copy()
    rate = rig.robot.posture.velocity.copy()
    rig.run(0.002)
    np.testing.assert_allclose((rig.robot.posture.position - before) / 0.002, rate, atol=0.02)


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.STANDBY, Mode.DAMPED])
def test_without_power_it_rests(bench, mode):
    rig = Rig(bench())
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.STAND, mode
    rig.run(2.0)
    assert rig.robot.posture.stance == Stance.RESTING


def test_damped_half_way_up_it_begins_anew_from_where_it_is(bench):
    rig = Rig(bench())
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.STAND, Mode.STANDING
    rig.run(0.7)
    half = rig.robot.joints.position.copy()
    rig.robot.safety.mode = Mode.DAMPED
    rig.task.step(rig.now_ns)
    assert rig.robot.posture.stance == Stance.RESTING
    rig.robot.safety.mode, rig.robot.joints.position = Mode.STANDING, half
    rig.task.step(rig.now_ns)
    np.testing.assert_allclose(rig.robot.posture.position, half, atol=1e-12)


def test_a_robot_that_stands_already_settles_quickly(bench):
    rig = Rig(bench())
    rig.robot.joints.position = rig.upright + 0.01
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.WALK, Mode.STANDING
    rig.run(0.32)
    assert rig.robot.posture.stance == Stance.STANDING


@pytest.mark.parametrize("height_m", [0.14, 0.2, 0.29])
def test_it_crouches_from_anywhere_in_bounded_time_and_without_a_jump(bench, height_m):
    rig = Rig(bench())
    config = rig.robot.config.posture
    begin = rig.robot.robot.standing_angles(height_m) + 0.1
    rig.robot.joints.position = begin
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.WALK, Mode.CROUCHING
    trace = rig.run(config.crouch_s)
    assert rig.robot.posture.stance == Stance.SITTING
    np.testing.assert_allclose(trace[0], begin, atol=1e-3)
    assert np.abs(np.diff(trace, axis=0)).max() < 0.02
    rig.run(0.004)
    assert rig.robot.posture.stance == Stance.RESTING
    np.testing.assert_allclose(trace[-1], rig.robot.robot.standing_angles(config.crouching_height_m), atol=1e-3)


def test_it_does_not_sit_down_while_it_walks(bench):
    rig = Rig(bench())
    rig.robot.joints.position = rig.upright
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.STAND, Mode.STANDING
    rig.run(1.0)
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.SIT, Mode.ACTIVE
    rig.run(0.5)
    assert rig.robot.posture.stance == Stance.STANDING
    rig.robot.safety.mode = Mode.STANDING
    rig.run(0.1)
    assert rig.robot.posture.stance == Stance.SITTING


@pytest.fixture
def sprawled(bench):
    """A robot with a leg beside it, that is to stand up."""
    rig = Rig(bench())
    rig.robot.joints.position = rig.seated + np.array([0.6, -0.8, 0.5] + [0.0] * 9)
    rig.robot.operator.motion, rig.robot.safety.mode = Motion.STAND, Mode.STANDING
    return rig


def test_legs_that_lie_about_are_gathered_before_the_robot_rises(sprawled):
    lying, rise_s = sprawled.robot.joints.position.copy(), sprawled.robot.config.posture.rise_s
    gathering = sprawled.run(rise_s)
    assert sprawled.robot.posture.stance == Stance.GATHERING
    rising = sprawled.run(rise_s + 0.1)
    assert sprawled.robot.posture.stance == Stance.STANDING
    np.testing.assert_allclose(gathering[0], lying, atol=1e-9)
    np.testing.assert_allclose(rising[0], sprawled.seated, atol=1e-3)
    assert np.abs(np.diff(np.vstack((gathering, rising)), 2, axis=0)).max() < 1e-3


def test_one_that_is_to_rest_after_all_stays_seated(sprawled):
    sprawled.run(0.5)
    sprawled.robot.operator.motion = Motion.SIT
    sprawled.run(sprawled.robot.config.posture.rise_s)
    assert sprawled.robot.posture.stance == Stance.RESTING
    np.testing.assert_allclose(sprawled.robot.joints.position, sprawled.seated, atol=1e-9)
