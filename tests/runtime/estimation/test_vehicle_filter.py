# SPDX-License-Identifier: Apache-2.0
"""The vehicle's estimator on motions that are known exactly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.estimation.vehicle_filter import leveled
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.models.rotations import matrix_of_quaternion, wrapped

MS = 1_000_000
SENSORS = {"imu": 1.0, "wheels": 0.02, "position": 0.02, "yaw": np.radians(0.5), "bias": 1.0}
"""As simulated: densities and biases of the IMU as shares of theirs, wheels in rad/s, localisation."""
NO_NOISE = dict.fromkeys(SENSORS, 0.0)
SETTLED_NS = 6_000 * MS


def planar_error(one):
    return np.array([*one.position_error[:2], one.yaw_error])


def normalized_square(one):
    error = planar_error(one)
    return error @ np.linalg.solve(one.state.covariance.reshape(3, 3), error)


def errors_of(one, twists):
    """Errors of x, y and yaw, at each step once the vehicle drives."""
    errors = []
    for twist in twists:
        one.step(twist)
        if one.now_ns > SETTLED_NS:
            errors.append(planar_error(one))
    return np.array(errors)


def rms(errors):
    """Of position, m, and of heading, rad."""
    return np.sqrt((errors[:, :2] ** 2).sum(axis=1).mean()), np.sqrt((errors[:, 2] ** 2).mean())


def test_nothing_is_published_before_the_first_pose_and_the_first_sample(drive):
    one = drive(NO_NOISE)
    one.localized = False
    for _ in range(10):
        one.step((0.0, 0.0, 0.0))
    assert one.state.stamp_ns == 0
    one.say(one.now_ns, (1.0, 2.0, 0.3), 1.0)
    one.step((0.0, 0.0, 0.0))
    assert one.state.stamp_ns == one.now_ns
    np.testing.assert_allclose(one.state.position, (1.0, 2.0, 0.3), atol=1e-3)


def test_without_noise_the_estimate_is_the_truth_in_any_manner_of_driving(drive):
    one = drive(NO_NOISE)
    for tick in range(2000):
        rise, t = min(1.0, max(0.0, tick - 100) / 100), tick / 100
        one.step(rise * np.array([np.sin(0.5 * t), 0.5 * np.cos(0.3 * t), 0.8 * np.sin(0.7 * t)]))
    assert np.abs(planar_error(one)).max() < 2e-3
    np.testing.assert_allclose(one.state.velocity, one.twist[:2], atol=0.01)
    assert one.state.angular_velocity[2] == pytest.approx(one.twist[2], abs=1e-3)


@pytest.mark.parametrize("seed", range(2))
def test_on_the_figure_eight_position_and_heading_keep_to_their_goals(drive, figure_eight, seed):
    position, heading = rms(errors_of(drive(SENSORS, seed), figure_eight(1.5, 36)))
    assert position < 0.02
    assert heading < np.radians(0.3)


@pytest.mark.parametrize("seed", range(2))
def test_without_localisation_less_than_a_hundredth_of_the_distance_is_lost(drive, figure_eight, seed):
    one = drive(SENSORS, seed)
    for twist in figure_eight(1.5, 60):
        one.localized = one.now_ns < 3_000 * MS
        one.step(twist)
    assert one.travelled > 80.0
    assert np.linalg.norm(one.position_error) < 0.01 * one.travelled
    assert one.state.localization_age_ns > 50_000 * MS


MATCHED = VehicleFilterConfig(
    acceleration_noise=0.0067,
    rate_noise=0.00067,
    acceleration_walk=1e-5,
    rate_walk=1e-6,
    localization_yaw_rad=np.radians(0.5),
    rolling_mps=0.004,
    rolling_share=1e-4,
    lateral_mps=0.002,
    steering_rad=1e-4,
    twist_mps=1e-4,
    twist_share=1e-4,
    twist_radps=1e-3,
    slip_gate=10.0,
    twist_gate=20.0,
)
"""The filter's noise as that of the sensors."""


def test_the_covariance_is_that_of_the_errors(drive, figure_eight):
    """Normalised squares of three errors, over independent drives: 3 on average, 95 % within [2.2, 3.9] for 30."""
    squares = []
    for seed in range(30):
        one = drive(SENSORS, seed, config=MATCHED)
        for twist in figure_eight(1.5, 8):
            one.step(twist)
        squares.append(normalized_square(one))
    assert 1.8 < np.mean(squares) < 4.3
    assert np.max(squares) < 20.0


@pytest.mark.parametrize("late_ms", [80, 250, 600])
def test_late_poses_leave_the_estimate_that_poses_on_time_would_have(drive, figure_eight, late_ms):
    """Once both have seen the same poses."""
    ends = []
    for late_ns in (0, late_ms * MS):
        one = drive(SENSORS, 5, late_ns=late_ns)
        for tick, twist in enumerate(figure_eight(1.5, 12)):
            one.localized = tick < 1100
            one.step(twist)
        ends.append(planar_error(one))
    np.testing.assert_allclose(ends[0][:2], ends[1][:2], atol=0.002)
    assert ends[0][2] == pytest.approx(ends[1][2], abs=np.radians(0.06))


class Textbook:
    """An extended Kalman filter of x, y, yaw and the gyroscope's bias, told of each pose at once."""

    def __init__(self, pose):
        self.x, self.p = np.array([*pose, 0.0]), np.diag((0.02, 0.02, 0.02, 0.01)) ** 2

    def predict(self, velocity, rate, seconds):
        x, y, yaw, bias = self.x
        yaw_middle = yaw + 0.5 * (rate - bias) * seconds
        c, s = np.cos(yaw_middle), np.sin(yaw_middle)
        step = seconds * np.array([c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1]])
        f = np.eye(4)
        f[0, 2], f[1, 2], f[2, 3] = -step[1], step[0], -seconds
        self.x = np.array([x + step[0], y + step[1], yaw + (rate - bias) * seconds, bias])
        noise = np.array([0.03 * seconds, 0.03 * seconds, 0.001 * np.sqrt(seconds), 2e-5 * np.sqrt(seconds)])
        self.p = f @ self.p @ f.T + np.diag(noise**2)

    def correct(self, pose):
        h = np.eye(3, 4)
        gain = self.p @ h.T @ np.linalg.inv(h @ self.p @ h.T + np.diag((0.02, 0.02, np.radians(0.5))) ** 2)
        error = pose - self.x[:3]
        error[2] = wrapped(error[2])
        self.x, self.p = self.x + gain @ error, (np.eye(4) - gain @ h) @ self.p


def test_it_is_as_good_as_a_textbook_filter_that_gets_its_poses_at_once(drive, figure_eight, vehicle):
    ours, theirs = [], []
    for seed in range(2):
        one, book, last = drive(SENSORS, seed), None, 0
        for twist in figure_eight(1.5, 20):
            one.step(twist)
            if one.state.stamp_ns == 0:
                continue
            if book is None:
                book = Textbook((*one.pose.position[:2], 2.0 * np.arctan2(*one.pose.orientation[2:])))
            c, s = np.cos(one.wheels.steering), np.sin(one.wheels.steering)
            rolling, motion = vehicle.radius * one.wheels.speed, vehicle.positions @ [[0.0, 1.0], [-1.0, 0.0]]
            rows = np.concatenate(
                (np.c_[c, s, c * motion[:, 0] + s * motion[:, 1]], np.c_[-s, c, -s * motion[:, 0] + c * motion[:, 1]])
            )
            velocity = np.linalg.lstsq(rows, np.concatenate((rolling, np.zeros(4))), rcond=None)[0]
            book.predict(velocity[:2], one.imu.angular_velocity[2], 0.01)
            if one.pending and one.pending[-1][0] != last and one.pending[-1][0] == one.now_ns:
                last, position, yaw = one.pending[-1]
                book.correct(np.array([*position[:2], yaw]))
            if one.now_ns > SETTLED_NS:
                ours.append(planar_error(one))
                theirs.append([*(book.x[:2] - one.position[:2]), wrapped(book.x[2] - one.yaw)])
    (position, heading), (their_position, their_heading) = rms(np.array(ours)), rms(np.array(theirs))
    assert position < 1.25 * their_position
    assert heading < 1.25 * their_heading


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.0, 3.0))
def test_the_specific_force_at_rest_shows_the_tilt(roll, pitch, yaw):
    c, s = np.cos, np.sin
    up = 9.81 * np.array([-s(pitch), s(roll) * c(pitch), c(roll) * c(pitch)])
    rotation = matrix_of_quaternion(leveled(yaw, up))
    np.testing.assert_allclose(rotation.T @ (0.0, 0.0, 9.81), up, atol=1e-9)
    assert wrapped(np.arctan2(rotation[1, 0], rotation[0, 0]) - yaw) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("slope", [(0.15, 0.0), (0.0, -0.2), (0.1, 0.15)])
def test_on_a_slope_the_vehicle_climbs_as_it_does(drive, figure_eight, slope):
    one = drive(SENSORS, 2, slope=slope)
    errors, heights = [], []
    for twist in figure_eight(1.0, 20):
        one.step(twist)
        if one.now_ns > SETTLED_NS:
            errors.append(planar_error(one))
            heights.append(one.position_error[2])
    position, heading = rms(np.array(errors))
    assert position < 0.02
    assert heading < np.radians(0.3)
    assert np.std([*heights, 0.0]) < 0.01
    np.testing.assert_allclose(matrix_of_quaternion(one.state.orientation), one.rotation, atol=0.015)


def test_at_rest_the_bias_of_the_gyroscope_is_found_and_the_vehicle_stays(drive):
    one = drive(SENSORS, 3)
    for tick in range(1000):
        one.localized = tick < 200
        one.step((0.0, 0.0, 0.0))
        if tick == 300:
            there = np.array(one.state.position)
    assert one.state.resting
    np.testing.assert_allclose(one.task.state.rate_bias, one.bias[3:], atol=5e-4)
    np.testing.assert_allclose(one.state.position, there, atol=1e-3)
    np.testing.assert_allclose(one.state.linear_velocity, 0.0, atol=1e-3)


@pytest.mark.parametrize("twist", [(0.02, 0.0, 0.0), (0.0, -0.02, 0.0), (0.0, 0.0, 0.06)], ids=str)
def test_a_vehicle_that_creeps_does_not_rest(drive, twist):
    one = drive(SENSORS, 4)
    for tick in range(1000):
        one.step(twist if tick > 200 else np.zeros(3))
        assert not (one.state.resting and tick > 250)
    assert np.abs(planar_error(one)).max() < 0.03


@pytest.mark.parametrize("which", [(0,), (1, 3), (0, 1), (0, 1, 2), (0, 1, 2, 3)], ids=str)
@pytest.mark.parametrize("spin", [1.5, 4.0, -3.0])
def test_wheels_that_slip_are_told_and_carry_the_estimate_nowhere(drive, figure_eight, which, spin):
    one, told, wrongly = drive(SENSORS, 1), 0, 0
    errors = []
    for tick, twist in enumerate(figure_eight(1.5, 13)):
        slips = 1200 <= tick < 1300
        one.spin[:] = 0.0
        one.spin[list(which)] = spin * slips
        one.step(twist)
        if slips:
            told += one.state.slipping[list(which)].sum()
            wrongly += one.state.slipping.sum() - one.state.slipping[list(which)].sum()
            errors.append(planar_error(one))
    # all at once leave but the accelerometer, which is believed against them for half a second
    assert told > (85 if len(which) < 4 else 50) * len(which)
    assert wrongly < 15
    assert np.abs(np.array(errors)[:, :2]).max() < (0.04 if len(which) < 3 else 0.15)
    assert one.state.localization_rejected == 0


@pytest.mark.parametrize("jump", [(0.6, 0.0, 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, 0.5), (np.nan, 0.0, 0.0)], ids=str)
def test_a_jump_of_the_localisation_is_rejected_counted_and_disputed(drive, figure_eight, jump):
    one, calm = drive(SENSORS, 6), drive(SENSORS, 6)
    for tick, twist in enumerate(figure_eight(1.0, 16)):
        for each in (one, calm):
            each.step(twist)
            if tick >= 1000:
                each.localized, each.pending = False, []
        if tick >= 1000 and tick % 10 == 0:
            one.say(one.now_ns, one.position + np.array([*jump[:2], 0.0]), one.yaw + jump[2])
    assert one.state.localization_rejected >= 59
    assert one.state.localization_disputed >= 59 or np.isnan(jump[0])
    np.testing.assert_array_equal(one.state.position, calm.state.position)
    assert one.state.localization_age_ns == calm.state.localization_age_ns > 5_000 * MS


def test_silence_of_the_localisation_shows_in_covariance_and_age(drive):
    one = drive(SENSORS, 7)
    spread = []
    for tick in range(1500):
        one.localized = tick < 500
        one.step((min(1.0, max(0.0, tick / 100 - 2.0)), 0.0, 0.0))
        if tick >= 600 and tick % 100 == 0:
            spread.append(one.state.covariance[[0, 4, 8]].copy())
    assert (np.diff(spread, axis=0) > 0.0).all()
    assert one.state.localization_age_ns > 9_500 * MS
    assert normalized_square(one) < 14.0


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_ticks_may_be_skipped(drive, figure_eight, seed):
    one, rng = drive(SENSORS, 8), np.random.default_rng(seed)
    errors = []
    for twist in figure_eight(1.5, 14):
        measured = rng.random() > 0.3
        one.step(twist, measured=measured)
        if measured and one.now_ns > SETTLED_NS:
            errors.append(planar_error(one))
    position, heading = rms(np.array(errors))
    assert position < 0.02
    assert heading < np.radians(0.4)


def test_without_the_imu_the_wheels_turn_the_vehicle(drive, figure_eight):
    one = drive(SENSORS, 9)
    for tick, twist in enumerate(figure_eight(1.5, 12)):
        silent = tick > 1000
        one.step(twist, felt=not silent)
    assert one.state.imu_age_ns > 1_900 * MS
    assert np.abs(planar_error(one)).max() < 0.1
    np.testing.assert_allclose(one.state.velocity, one.twist[:2], atol=0.05)


@pytest.mark.parametrize("how", ["old", "nan", "fault"])
def test_a_wheel_that_says_nothing_good_is_not_gone_by(drive, figure_eight, how):
    one, errors = drive(SENSORS, 10), []
    for tick, twist in enumerate(figure_eight(1.5, 14)):
        one.broken = (how, 2) if tick > 800 else None
        one.step(twist)
        if tick > 800:
            errors.append(planar_error(one))
    assert rms(np.array(errors))[0] < 0.02
    assert (one.state.wheels_rejected > 500) == (how == "nan")
    assert (one.state.wheels_age_ns > 5_000 * MS) == (how == "old")


def test_a_restored_task_goes_on_bit_for_bit(drive, figure_eight):
    one, other = drive(SENSORS, 11), drive(SENSORS, 11)
    for tick, twist in enumerate(figure_eight(1.5, 8)):
        one.step(twist)
        other.step(twist)
        if tick == 500:
            state = one.task.save()
            other.task.state.clear()
            other.task.restore(state)
    assert one.state.to_bytes() == other.state.to_bytes()
    assert one.task.save() == other.task.save()
