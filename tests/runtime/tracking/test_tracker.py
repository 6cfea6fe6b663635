# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from runtime.tracking.look_ahead import FixedLookAhead, FuzzyLookAhead
from runtime.tracking.paths import circle, line, s_curve, straight
from runtime.tracking.tracker import PathTracker
from runtime.tracking.tracker_config import TrackerConfig

FIXED_2M = TrackerConfig(look_ahead=FixedLookAhead(2.0))
ZIGZAG = np.array([(0.0, 0.0), (4.0, 0.0), (6.0, 2.0), (6.0, 6.0)])


def goal_distance(run):
    return math.hypot(run.x - run.line.goal[0], run.y - run.line.goal[1])


@pytest.mark.parametrize(
    ("config", "bound"), [(FIXED_2M, 0.070), (TrackerConfig(look_ahead=FixedLookAhead(1.5)), 0.03), (None, 0.03)]
)
def test_s_curve_by_an_ideal_unicycle(drive, config, bound):
    run = drive(s_curve(), speed=0.5, config=config or TrackerConfig()).run()
    assert run.distances.mean() < bound
    assert run.command.arrived
    assert goal_distance(run) < 0.05


def test_circle_closes_without_leaving_it_at_the_end(drive):
    run = drive(circle(), closed=True, lag_s=0.2).run()
    assert run.distances.max() < 0.005
    assert goal_distance(run) < 0.05
    assert run.command.progress == pytest.approx(10 * math.pi, abs=0.05)


def test_noise_at_the_start_of_a_closed_path_is_not_taken_for_its_end(drive):
    run = drive(circle(), closed=True, noise_m=0.05, seed=3)
    for _ in range(200):
        run.tick()
    assert not run.command.arrived


def test_a_lateral_drift_leaves_no_steady_offset(drive):
    run = drive(straight(15.0), drift_mps=0.02, config=FIXED_2M).run()
    # Pursuit on the yaw alone would stand off by b l / v = 67 mm.
    assert run.distances[1500:2000].max() < 0.003


@pytest.mark.parametrize("gain", [0.93, 1.0, 1.07])
def test_mean_speed_is_as_commanded_though_the_robot_is_fast_or_slow(drive, gain):
    run = drive(straight(10.0), speed_gain=gain, lag_s=0.2).run()
    t, x = np.array(run.history)[:, :2].T
    mean = 8.0 / (np.interp(9.0, x, t) - np.interp(1.0, x, t))
    assert mean == pytest.approx(0.6, rel=0.015)


def test_mirrored_paths_are_tracked_as_mirror_images(drive):
    left = drive(ZIGZAG, lag_s=0.1, start=(0.0, 0.2, 0.1)).run()
    right = drive(ZIGZAG * (1, -1), lag_s=0.1, start=(0.0, -0.2, -0.1)).run()
    mirror = np.array((1, 1, -1, -1, 1))
    np.testing.assert_allclose(np.array(left.history), np.array(right.history) * mirror, atol=1e-9)


def test_facing_away_it_turns_in_place_first(drive):
    run = drive(straight(3.0), start=(0.0, 0.0, -2.5), lag_s=0.1)
    for _ in range(100):
        run.tick()
    assert math.hypot(run.x, run.y) < 0.02
    assert run.tracker.state.turning
    run.run()
    assert run.distances.max() < 0.1
    assert goal_distance(run) < 0.05


def test_speed_ramps_and_stops(drive):
    run = drive(straight(6.0))
    speeds = []
    while not run.command.arrived:
        run.tick()
        speeds.append(run.command.velocity[0])
    assert max(abs(np.diff(speeds[:-1]))) <= 0.03
    assert max(speeds) == pytest.approx(0.6)
    assert speeds[-1] == 0.0
    assert goal_distance(run) < 0.05


def test_the_command_does_not_run_away_from_a_robot_that_stands(drive):
    run = drive(straight(6.0), speed=1.5, speed_gain=0.0)
    for _ in range(400):
        run.tick()
    assert run.command.velocity[0] <= 0.4
    assert run.tracker.state.trim == 0.0


def steps(run, count):
    """Run on and give every command's bytes."""
    out = []
    for _ in range(count):
        run.tick()
        out.append(run.command.to_bytes())
    return out


def test_restored_in_another_object_it_goes_on_bit_for_bit(drive):
    run = drive(s_curve(), noise_m=0.02, lag_s=0.2)
    steps(run, 1201)
    twin = PathTracker(run.path, run.body, run.request, run.safety, run.command.like(), 60_000_000_000, run.config)
    twin.restore(run.tracker.save())
    for _ in range(800):
        run.tick()
        if run.ticks % 4 == 1:
            twin.step(run.body.stamp_ns)
            assert twin._command.to_bytes() == run.command.to_bytes()
            assert twin.save() == run.tracker.save()


def test_a_key_frame_taken_of_itself_changes_nothing(drive):
    plain, interrupted = (drive(s_curve(), noise_m=0.02) for _ in range(2))
    for _ in range(8):
        assert steps(plain, 100) == steps(interrupted, 100)
        interrupted.tracker.restore(interrupted.tracker.save())


def test_a_restored_state_brings_its_own_path(drive):
    run = drive(ZIGZAG)
    steps(run, 400)
    saved = run.tracker.save()
    other = drive(straight(20.0))
    steps(other, 400)
    other.tracker.restore(saved)
    assert other.tracker._followed.line.length == run.line.length


def test_two_runs_are_identical(drive):
    runs = [steps(drive(line(), noise_m=0.02, start=(0.0, 0.0, 0.7)), 800) for _ in range(2)]
    assert runs[0] == runs[1]


def spoil_nan(path):
    path.x[1] = math.nan


def spoil_count(path):
    path.count = 100_000


def spoil_repeat(path):
    path.x[1], path.y[1] = path.x[0], path.y[0]


def spoil_speed(path):
    path.speed = math.nan


def spoil_backwards(path):
    path.speed = -0.5


def spoil_one_point(path):
    path.count = 1


@pytest.mark.parametrize("spoil", [spoil_nan, spoil_count, spoil_repeat, spoil_speed, spoil_backwards, spoil_one_point])
def test_a_bad_path_is_counted_once_and_the_last_good_one_kept(drive, spoil):
    run, untouched = drive(ZIGZAG), drive(ZIGZAG)
    steps(run, 400)
    steps(untouched, 400)
    run.path.stamp_ns += 1
    spoil(run.path)
    steps(run, 200)
    steps(untouched, 200)
    assert run.command.rejected_paths == 1
    assert (run.x, run.y, run.yaw) == (untouched.x, untouched.y, untouched.yaw)


def test_a_path_of_another_than_the_lease_s_holder_is_counted_and_the_last_good_one_kept(drive):
    run, untouched = drive(ZIGZAG), drive(ZIGZAG)
    for one in (run, untouched):
        one.request.held, one.request.holder, one.path.source = True, 7, 7
        steps(one, 400)
    run.path.stamp_ns, run.path.source, run.path.count = 2, 8, 0
    steps(run, 200)
    steps(untouched, 200)
    assert (run.command.rejected_paths, run.command.foreign_paths) == (1, 1)
    assert (run.x, run.y, run.yaw) == (untouched.x, untouched.y, untouched.yaw)


def test_a_bad_first_path_leaves_the_robot_standing(drive):
    run = drive(ZIGZAG)
    spoil_nan(run.path)
    steps(run, 40)
    assert run.command.rejected_paths == 1
    assert run.command.velocity.tolist() == [0.0, 0.0]
    assert not run.command.arrived


@pytest.mark.parametrize("name", ["position", "orientation", "course_velocity", "angular_velocity", "plane_normal"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_body_state_that_is_not_finite_stops_the_robot_until_it_is_again(drive, name, value):
    run = drive(straight(6.0))
    steps(run, 400)
    getattr(run.body, name)[0] = value
    run.tracker.step(run.now_ns)
    assert run.command.velocity.tolist() == [0.0, 0.0]
    assert run.command.yaw_rate == 0.0
    assert all(np.isfinite(getattr(run.command, f.name)).all() for f in run.command.fields)
    steps(run, 100)
    assert run.command.velocity[0] > 0.0
    assert np.isfinite(run.command.target).all()


def test_a_body_state_never_written_gives_no_motion(drive):
    run = drive(straight(6.0))
    run.tracker.step(run.now_ns)
    assert run.command.velocity.tolist() == [0.0, 0.0]


def test_without_a_path_it_holds_its_heading(drive):
    run = drive(straight(6.0), start=(0.0, 0.0, 0.4))
    run.path.clear()
    steps(run, 10)
    run.yaw = 0.6
    steps(run, 10)
    assert run.command.heading == pytest.approx(0.4)
    assert run.command.velocity.tolist() == [0.0, 0.0]


def test_the_same_waypoints_again_change_only_the_speed(drive):
    run = drive(straight(6.0))
    steps(run, 500)
    progress = run.command.progress
    run.speed = 0.3
    run.send(stamp_ns=2)
    steps(run, 200)
    assert run.command.progress > progress
    assert run.command.velocity[0] == pytest.approx(0.3, abs=0.03)


def test_a_path_is_run_again_after_its_withdrawal(drive):
    run = drive(circle(1.0), closed=True).run()
    run.send(stamp_ns=2)
    steps(run, 10)
    assert run.command.arrived
    run.path.count = 0
    steps(run, 10)
    assert not run.command.arrived
    run.send(stamp_ns=3)
    steps(run, 100)
    assert run.command.velocity[0] > 0.1
    assert 0.0 < run.command.progress < 2.0


def test_the_log_fields_hold_what_was_used(drive):
    run = drive(circle(), closed=True)
    steps(run, 1000)
    command = run.command
    assert command.look_ahead == pytest.approx(
        math.hypot(command.target[0] - run.body.position[0], command.target[1] - run.body.position[1])
    )
    policy = run.config.look_ahead
    assert isinstance(policy, FuzzyLookAhead)
    assert policy.k_w0 - 3.0 <= command.k_w <= policy.k_w0 + 3.0
    assert command.progress + command.remaining == pytest.approx(run.line.length)


def test_signs_of_the_errors(drive):
    run = drive(straight(6.0), start=(1.0, 0.2, 0.1))
    run.tick()
    assert run.command.lateral_error == pytest.approx(0.2)  # the robot is left of the path, the path to its right
    assert run.command.heading_error == pytest.approx(0.1)
