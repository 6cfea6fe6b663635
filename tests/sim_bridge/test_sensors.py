# SPDX-License-Identifier: Apache-2.0
"""Virtual sensors say what their configuration promises: noise, bias, rate and lateness."""

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from runtime.robots import load_configuration
from runtime.signals import Battery, Imu, Pose
from sim_bridge.sensors import BatterySensor, InertialSensor, LocalizationSensor

CONFIG = load_configuration("uslgo1").simulation
MS = 1_000_000
GRAVITY = np.array([0.0, 0.0, 9.81])


def changed(**changes):
    return msgspec.structs.replace(CONFIG, **changes)


def samples(config, seconds, seed=0, acceleration=GRAVITY, rate=(0.0, 0.0, 0.0)):
    """Every sample of an IMU at rest or in steady motion, (n, 6), and their stamps."""
    sensor, record = InertialSensor(config, np.random.default_rng(seed)), Imu("/imu")
    values, stamps = [], []
    motion = np.array([*acceleration, *rate])
    for step in range(1, int(seconds * 1000) + 1):
        sensor.feel(motion, step * MS)
        if sensor.read(record, step * MS):
            values.append([*record.linear_acceleration, *record.angular_velocity])
            stamps.append(record.stamp_ns)
            assert record.sequence == len(values)
    return np.array(values), np.array(stamps)


NOISELESS = changed(
    imu_acceleration_noise=0.0,
    imu_rate_noise=0.0,
    imu_acceleration_bias_mps2=0.0,
    imu_rate_bias_radps=0.0,
    imu_acceleration_walk=0.0,
    imu_rate_walk=0.0,
)


def test_at_rest_it_feels_gravity_upwards_up_to_bias_and_noise():
    values, _ = samples(CONFIG, 4.0)
    mean = values.mean(axis=0)
    # four deviations of the bias, and of the mean's noise
    assert (np.abs(mean[:3] - GRAVITY) < 4 * 0.05 + 4 * 0.003 * np.sqrt(500 / 2000)).all()
    assert (np.abs(mean[3:]) < 4 * 0.003 + 4 * 0.0003).all()


@pytest.mark.parametrize("rate_hz", [100, 250, 500, 1000])
def test_it_samples_at_its_rate_with_the_stamp_of_the_sample(rate_hz):
    _, stamps = samples(changed(imu_rate_hz=rate_hz), 1.0)
    assert stamps.tolist() == [int(k * 1e9 / rate_hz) for k in range(1, rate_hz + 1)]


@pytest.mark.parametrize("rate_hz", [250, 500])
def test_white_noise_has_the_configured_density(rate_hz):
    config = changed(imu_rate_hz=rate_hz, imu_acceleration_walk=0.0, imu_rate_walk=0.0)
    values, _ = samples(config, 20.0)
    deviation = values.std(axis=0, ddof=1)
    expected = np.repeat((0.003, 0.0003), 3) * np.sqrt(rate_hz)
    # 5000 samples and more: one percent is one deviation of the estimate
    np.testing.assert_allclose(deviation, expected, rtol=0.05)
    neighbours = [np.corrcoef(column[:-1], column[1:])[0, 1] for column in values.T]
    assert np.abs(neighbours).max() < 0.06


def test_initial_biases_spread_as_configured():
    config = changed(imu_acceleration_noise=0.0, imu_rate_noise=0.0, imu_acceleration_walk=0.0, imu_rate_walk=0.0)
    biases = np.array([samples(config, 0.002, seed)[0][0] - [*GRAVITY, 0, 0, 0] for seed in range(400)])
    np.testing.assert_allclose(biases[:, :3].std(), 0.05, rtol=0.1)
    np.testing.assert_allclose(biases[:, 3:].std(), 0.003, rtol=0.1)
    assert np.abs(biases.mean(axis=0) / np.repeat((0.05, 0.003), 3)).max() < 0.2


def test_biases_walk_as_configured():
    config = changed(
        imu_acceleration_noise=0.0,
        imu_rate_noise=0.0,
        imu_acceleration_bias_mps2=0.0,
        imu_rate_bias_radps=0.0,
        imu_acceleration_walk=0.01,
        imu_rate_walk=0.001,
    )
    seconds = 2.0
    ends = np.array([samples(config, seconds, seed)[0][-1] - [*GRAVITY, 0, 0, 0] for seed in range(60)])
    np.testing.assert_allclose(ends[:, :3].std(), 0.01 * np.sqrt(seconds), rtol=0.2)
    np.testing.assert_allclose(ends[:, 3:].std(), 0.001 * np.sqrt(seconds), rtol=0.2)


def test_a_sample_is_the_mean_over_its_period():
    sensor, record = InertialSensor(NOISELESS, np.random.default_rng(0)), Imu("/imu")
    for step, value in enumerate((1.0, 5.0), start=1):
        sensor.feel(np.repeat((value, -value), 3), step * MS)
    assert sensor.read(record, 2 * MS)
    assert record.linear_acceleration.tolist() == [3.0] * 3
    assert record.angular_velocity.tolist() == [-3.0] * 3
    assert not sensor.read(record, 2 * MS), "a sample is given once"


def test_seeds_of_the_imu():
    one, again, other = (samples(CONFIG, 0.2, seed)[0].tobytes() for seed in (1, 1, 2))
    assert one == again != other


def poses(seconds, seed=0, config=CONFIG, yaw=0.0, velocity=(0.6, 0.0, 0.0)):
    """(read at, stamp, sequence, position, rotation) of each pose that arrives."""
    sensor, record, found = LocalizationSensor(config, np.random.default_rng(seed)), Pose("/pose"), []
    orientation = pin.Quaternion(pin.rpy.rpyToMatrix(0, 0, yaw)).coeffs()
    for step in range(int(seconds * 1000) + 1):
        now_ns = step * MS
        if sensor.due(now_ns):
            sensor.see(np.array(velocity) * now_ns * 1e-9, orientation, now_ns)
        if step % 2 == 0 and sensor.read(record, now_ns):
            rotation = pin.Quaternion(np.array(record.orientation)).toRotationMatrix()
            found.append((now_ns, record.stamp_ns, record.sequence, np.array(record.position), rotation))
    return found


def test_poses_arrive_80_ms_late_with_the_stamp_of_their_acquisition():
    found = poses(3.0)
    assert len(found) == 30
    for count, (read_ns, stamp_ns, sequence, position, _) in enumerate(found):
        assert stamp_ns == count * 100 * MS
        assert read_ns - stamp_ns == 80 * MS
        assert sequence == count + 1
        # where the robot was then, not where it is now
        assert abs(position[0] - 0.6 * stamp_ns * 1e-9) < 5 * 0.02


def test_poses_are_unbiased_and_spread_by_2_cm_and_half_a_degree_an_axis():
    found = poses(100.0, yaw=1.2)
    errors = np.array([pose - (0.6 * stamp * 1e-9, 0, 0) for _, stamp, _, pose, _ in found])
    truth = pin.rpy.rpyToMatrix(0, 0, 1.2)
    turns = np.array([pin.log3(rotation @ truth.T) for *_, rotation in found])
    count = len(found)
    assert count > 990
    np.testing.assert_allclose(errors.std(axis=0), 0.02, rtol=0.1)
    np.testing.assert_allclose(turns.std(axis=0), np.radians(0.5), rtol=0.1)
    assert (np.abs(errors.mean(axis=0)) < 4 * 0.02 / np.sqrt(count)).all()
    assert (np.abs(turns.mean(axis=0)) < 4 * np.radians(0.5) / np.sqrt(count)).all()
    assert np.abs(np.corrcoef(errors.T, turns.T) - np.eye(6)).max() < 0.15


def test_orientations_are_unit_quaternions():
    for *_, rotation in poses(1.0):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_the_battery_sags_and_drains_with_power():
    sensor, record = BatterySensor(CONFIG), Battery("/battery")
    idle = BatterySensor.IDLE_W / 29.4
    for _ in range(1000):
        sensor.drain(0.0, 0.001)
    assert sensor.read(record, 0)
    assert record.current == pytest.approx(idle)
    assert record.voltage == pytest.approx(29.4 - 0.05 * idle)
    assert record.charge == pytest.approx(1.0 - idle / 3600.0 / 8.0)
    before = record.charge
    for _ in range(1000):
        sensor.drain(400.0, 0.001)
    assert not sensor.read(record, 99 * MS)
    assert sensor.read(record, 100 * MS)
    assert before - record.charge == pytest.approx((400 + 40) / 29.4 / 3600 / 8)
    sensor.drain(-1e6, 0.001)
    assert sensor.read(record, 200 * MS)
    assert record.current == pytest.approx(idle), "it does not charge itself"
