# SPDX-License-Identifier: Apache-2.0
"""The tracker slows to a stand when it must, goes on when it may, and follows an operator's velocity."""

import numpy as np
import pytest

from runtime.signals import Fault, Mode, Motion, Steering
from runtime.tracking.speed import SpeedLimits
from runtime.tracking.velocity import REST, PlanarVelocity, VelocityLimits, approached, wanted_velocity

STRAIGHT = np.array([[0.0, 0.0], [20.0, 0.0]])
STEP_S = 0.04
"""The tracker's own period in these runs."""


def running(drive, seconds=4.0):
    """A robot at full speed on a long straight path."""
    run = drive(STRAIGHT)
    run.safety.mode, run.request.motion = Mode.ACTIVE, Motion.WALK
    go(run, seconds)
    assert run.command.velocity[0] > 0.55
    return run


def go(run, seconds):
    """The commands of so many seconds, one row a step of the tracker."""
    commands = []
    for _ in range(round(seconds / run.tick_s)):
        run.tick()
        if run.ticks % 4 == 1:
            commands.append((*run.command.velocity, run.command.yaw_rate))
    return np.array(commands)


def halt(run):
    run.safety.halt = Fault.STALE_LOCALIZATION


def ask_to_stand(run):
    run.request.motion = Motion.STAND


def withdraw_the_path(run):
    run.path.count = 0


@pytest.mark.parametrize("stop", [halt, ask_to_stand, withdraw_the_path])
def test_it_slows_to_a_stand_no_faster_than_it_may(drive, stop):
    run = running(drive)
    stop(run)
    speed = go(run, 3.0)[:, 0]
    limits = run.config.speed
    assert (np.diff(speed) <= 1e-12).all()
    assert (np.diff(speed) >= -limits.deceleration_mps2 * STEP_S * (1 + limits.trim_maximum) - 1e-9).all()
    assert speed[-1] == 0.0
    assert not np.any(go(run, 1.0))


def test_it_goes_on_from_where_it_stands_when_it_is_let(drive):
    run = running(drive)
    halt(run)
    go(run, 3.0)
    progress = run.command.progress
    run.safety.halt = 0
    speed = go(run, 3.0)[:, 0]
    assert (np.diff(speed)[:10] <= run.config.speed.acceleration_mps2 * STEP_S + 1e-9).all()
    assert speed[-1] > 0.55
    assert run.command.progress > progress + 0.5


def test_a_halted_robot_does_not_turn_in_place(drive):
    run = drive(STRAIGHT, start=(0.0, 0.0, 2.5))
    go(run, 0.4)
    assert run.command.yaw_rate != 0.0
    halt(run)
    assert not np.any(go(run, 2.0)[-10:])


def test_before_it_may_walk_a_motion_that_is_not_walking_halts_nothing(drive):
    """The command is ready when the robot is."""
    run = drive(STRAIGHT)
    run.safety.mode, run.request.motion = Mode.STANDING, Motion.STAND
    assert go(run, 1.0)[-1, 0] > 0.0


def steered(drive, velocity):
    run = running(drive)
    run.request.steering = Steering.VELOCITY
    run.request.velocity = velocity
    return run


def test_a_velocity_is_followed_instead_of_the_path(drive):
    run = steered(drive, (-0.2, 0.1, 0.3))
    for _ in range(40):
        run.request.velocity_ns = run.now_ns
        commands = go(run, 0.1)
    np.testing.assert_allclose(commands[-1], (-0.2, 0.1, 0.3))


def test_an_old_velocity_ramps_to_a_stand(drive):
    run = steered(drive, (0.4, 0.0, 0.2))
    run.request.velocity_ns = run.now_ns
    age_s = run.config.velocity.age_max_ns * 1e-9
    commands = go(run, age_s + 2.0)
    np.testing.assert_allclose(commands[round(age_s / STEP_S) - 1], (0.4, 0.0, 0.2), atol=0.1)
    assert not commands[-1].any()
    fastest = run.config.speed.deceleration_mps2 * STEP_S + 1e-9
    assert (np.abs(np.diff(commands[2:, 0])) <= fastest).all()


def test_a_halted_robot_follows_no_velocity(drive):
    run = steered(drive, (0.4, 0.0, 0.2))
    halt(run)
    for _ in range(20):
        run.request.velocity_ns = run.now_ns
        commands = go(run, 0.1)
    assert not commands[-1].any()


def test_the_path_goes_on_after_the_velocity(drive):
    run = steered(drive, (0.0, 0.15, 0.0))
    for _ in range(20):
        run.request.velocity_ns = run.now_ns
        go(run, 0.1)
    run.request.steering = Steering.PATH
    commands = go(run, 3.0)
    assert np.abs(np.diff(commands[:, 1])).max() <= run.config.speed.deceleration_mps2 * STEP_S + 1e-9
    assert commands[-1, 1] == 0.0
    assert commands[-1, 0] > 0.5


@pytest.mark.parametrize("asked", [(9.0, 9.0, 9.0), (-9.0, -9.0, -9.0)])
def test_a_velocity_is_followed_within_its_limits(drive, asked):
    run = drive(STRAIGHT)
    run.request.velocity, run.request.velocity_ns = asked, 1
    limits, speed = VelocityLimits(), SpeedLimits()
    wanted = wanted_velocity(run.request, 2, limits, speed)
    assert -limits.backward_mps <= wanted.forward <= limits.forward_mps
    assert abs(wanted.lateral) == limits.lateral_mps
    assert abs(wanted.yaw_rate * wanted.forward) <= speed.lateral_acceleration_mps2 + 1e-12
    assert wanted_velocity(run.request, limits.age_max_ns + 2, limits, speed) == REST


def test_rest_is_reached_exactly():
    present = PlanarVelocity(0.31, -0.07, 0.4)
    for _ in range(100):
        present = approached(present, REST, SpeedLimits(), STEP_S)
    assert present == REST
