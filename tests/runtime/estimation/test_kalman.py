# SPDX-License-Identifier: Apache-2.0
"""The filter on motions that are known exactly."""

import numpy as np
import pinocchio as pin
import pytest

from runtime import signals
from runtime.estimation import kalman
from runtime.estimation.contact import normal_force
from runtime.estimation.kalman_task import KalmanTask
from runtime.models.inertial import InertialConfig
from runtime.models.leg_dynamics import LegDynamics
from runtime.models.leg_kinematics import LegKinematics
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import yaw_of_quaternion
from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import sizes

CONFIG = load_configuration("uslgo1")
ROBOT, SIZES = CONFIG.quadruped, sizes(CONFIG)
LEGS = LegKinematics(ROBOT)
MS, PERIOD_NS = 1_000_000, 2_000_000
RADIUS = ROBOT.foot_radius_m
DOWN = np.array([0.0, 0.0, -RADIUS])


def rates_for(angles, velocity, yaw_rate=0.0):
    """Joint rates with which the contact points of all four feet rest under a level trunk that moves."""
    legs = LEGS.forward(angles, np.zeros(12))
    columns = []
    for joint in range(12):
        one = LEGS.forward(angles, np.eye(12)[joint])
        columns.append((one.velocity + np.cross(one.shank_rate, DOWN)).ravel())
    points = legs.position + DOWN
    wanted = -(np.array([*velocity, 0.0]) + np.cross((0.0, 0.0, yaw_rate), points))
    return np.linalg.solve(np.array(columns).T, wanted.ravel())


class Rig:
    """An estimator with sensors that say what a test wants."""

    def __init__(self, yaw=0.0, position=(0.0, 0.0, 0.29), config=CONFIG.kalman):
        self.imu, self.pose = signals.Imu("/imu"), signals.Pose("/pose")
        self.joints, self.gait = signals.JointState("/joints", SIZES), signals.Gait("/gait", SIZES)
        self.body = signals.BodyState("/body", SIZES)
        self.operator = signals.OperatorRequest("/operator")
        records = self.imu, self.joints, self.pose, self.gait, self.operator, self.body
        self.task = KalmanTask(ROBOT, config, InertialConfig(), PERIOD_NS, *records)
        self.joints.position = ROBOT.standing_angles(0.29)
        self.imu.linear_acceleration = (0.0, 0.0, GRAVITY)
        self.now_ns = 1000 * MS
        self.say(position, yaw)

    def say(self, position, yaw=0.0, stamp_ns=None, tilt=(0.0, 0.0)):
        """A pose of the localisation sensor."""
        self.pose.stamp_ns = self.now_ns if stamp_ns is None else stamp_ns
        self.pose.sequence += 1
        self.pose.position = position
        self.pose.orientation = pin.Quaternion(pin.rpy.rpyToMatrix(*tilt, yaw)).coeffs()

    def step(self, fresh=True):
        """One tick, with a new inertial sample or without."""
        self.now_ns += PERIOD_NS
        if fresh:
            self.imu.stamp_ns = self.now_ns
            self.imu.sequence += 1
        self.task.step(self.now_ns)

    @property
    def rotation(self):
        return pin.Quaternion(np.array(self.body.orientation)).toRotationMatrix()


def test_nothing_is_published_before_the_first_pose():
    rig = Rig()
    rig.pose.stamp_ns = 0
    for _ in range(10):
        rig.step()
    assert rig.body.stamp_ns == 0
    assert not rig.task.state.started
    rig.say((1.0, 2.0, 0.3), 1.0)
    rig.step()
    assert rig.body.stamp_ns == rig.now_ns
    np.testing.assert_allclose(rig.body.position, (1.0, 2.0, 0.3), atol=1e-3)


def test_at_rest_the_biases_of_the_gyroscope_are_found_and_the_robot_stays():
    rig, bias = Rig(yaw=0.4), np.array([0.006, -0.004, 0.005])
    rng = np.random.default_rng(0)
    for tick in range(6_000):
        rig.imu.angular_velocity = bias + 0.007 * rng.standard_normal(3)
        rig.imu.linear_acceleration = np.array([0.0, 0.0, GRAVITY]) + 0.07 * rng.standard_normal(3)
        if tick % 50 == 0:
            noise = rng.standard_normal(4)
            rig.say(np.array([0.0, 0.0, 0.29]) + 0.02 * noise[:3], 0.4 + 0.0087 * noise[3])
        rig.step()
    np.testing.assert_allclose(rig.task.state.rate_bias, bias, atol=1e-3)
    np.testing.assert_allclose(rig.body.linear_velocity, 0.0, atol=0.005)
    np.testing.assert_allclose(rig.body.position, (0.0, 0.0, 0.29), atol=0.012)
    np.testing.assert_allclose(pin.rpy.matrixToRpy(rig.rotation), (0.0, 0.0, 0.4), atol=0.006)


@pytest.mark.parametrize("tilt", [(0.05, 0.0), (0.0, -0.08), (0.04, 0.06)])
def test_a_robot_that_starts_tilted_finds_the_vertical(tilt):
    """But for what the accelerometer's bias may be: the two look alike at rest, split as their variances (4 : 1)."""
    rig = Rig()
    rotation = pin.rpy.rpyToMatrix(*tilt, 0.0)
    rig.imu.linear_acceleration = rotation.T @ (0.0, 0.0, GRAVITY)
    for tick in range(3000):
        if tick % 50 == 0:
            rig.say((0.0, 0.0, 0.29), tilt=tilt)
        rig.step()
    remaining = np.linalg.norm(pin.log3(rotation.T @ rig.rotation)[:2])
    ambiguous = 0.1**2 / (0.1**2 + (0.02 * GRAVITY) ** 2)
    assert remaining < 1.1 * ambiguous * np.hypot(*tilt)
    np.testing.assert_allclose(rig.body.linear_velocity, 0.0, atol=0.003)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.4])
def test_standing_feet_give_the_velocity(yaw_rate):
    rig, velocity = Rig(), (0.3, 0.1)
    rig.joints.velocity = rates_for(rig.joints.position, velocity, yaw_rate)
    rig.imu.angular_velocity = (0.0, 0.0, yaw_rate)
    yaw = 0.0
    for _ in range(500):
        # turning, a constant velocity in base is an acceleration
        rig.imu.linear_acceleration = (-yaw_rate * velocity[1], yaw_rate * velocity[0], GRAVITY)
        rig.step()
        yaw += yaw_rate * 0.002
    np.testing.assert_allclose(rig.rotation.T @ rig.body.linear_velocity, (*velocity, 0.0), atol=2e-3)


def test_rolling_feet_short_by_their_radius_are_compensated():
    """A shank that pivots stiffly about the hip rolls its foot: the trunk moves at rate x (L + r), not rate x L."""
    angles = ROBOT.standing_angles(0.29)
    legs = LEGS.forward(angles, np.tile([0.0, 1.0, 0.0], 4))
    reach = -(legs.position[:, 2] - ROBOT.hip_positions()[:, 2])
    np.testing.assert_allclose(legs.velocity[:, 0], reach, atol=1e-9)
    memory = kalman.KalmanMemory("/memory")
    kalman.start(memory, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    standing, vertical = np.arange(4), np.array([0.0, 0.0, 1.0])

    def residual(velocity, radius):
        memory.velocity = (velocity, 0.0, 0.0)
        measured = kalman.contact_measurement(
            memory.table[0], np.eye(3), np.zeros(3), legs, standing, np.full(4, 0.03), vertical, radius
        )
        return measured.residual.reshape(4, 3)[:, 0]

    length = float(reach[0])
    np.testing.assert_allclose(residual(-(length + RADIUS), RADIUS), 0.0, atol=1e-9)
    np.testing.assert_allclose(residual(-length, 0.0), 0.0, atol=1e-9)
    assert (length + RADIUS) / length == pytest.approx(1.0741, abs=1e-3)


def walk(rig, speed, seconds, late_ns, noise=None):
    """Constant speed along x on feet that rest, with poses that come late; the error of the estimate at each pose."""
    start_ns, errors = rig.now_ns, []
    rig.joints.velocity = rates_for(rig.joints.position, (speed, 0.0))
    pending = []
    for tick in range(int(seconds * 500)):
        at = (rig.now_ns - start_ns) * 1e-9
        if tick % 50 == 0:
            spread = 0.0 if noise is None else 0.02 * noise.standard_normal(3)
            pending.append((rig.now_ns, np.array([speed * at, 0.0, 0.29]) + spread))
        while pending and pending[0][0] + late_ns <= rig.now_ns:
            stamp, position = pending.pop(0)
            rig.say(position, stamp_ns=stamp)
        rig.step()
        errors.append(rig.body.position - (speed * (rig.now_ns - start_ns) * 1e-9, 0.0, 0.29))
    return np.array(errors)


def test_a_late_pose_is_compared_with_the_estimate_of_its_own_time():
    errors = walk(Rig(), 0.6, 6.0, 80 * MS)
    # taken for present, each pose would pull the estimate back by 0.6 m/s x 80 ms = 48 mm
    assert np.abs(errors[1500:, 0]).max() < 0.005
    assert np.abs(errors[1500:, 1:]).max() < 0.005


def test_late_and_noisy_poses_leave_no_bias():
    errors = walk(Rig(), 0.6, 10.0, 80 * MS, np.random.default_rng(1))
    assert abs(errors[1500:, 0].mean()) < 0.005
    assert np.abs(errors[1500:, 0]).max() < 0.03


def test_a_pose_older_than_the_history_is_rejected_and_counted():
    rig = Rig()
    for _ in range(500):
        rig.step()
    before = np.array(rig.body.position)
    rig.say((0.05, 0.0, 0.29), stamp_ns=rig.now_ns - 400 * MS)
    rig.step()
    assert rig.body.localization_rejected == 1
    np.testing.assert_allclose(rig.body.position, before, atol=1e-4)


@pytest.mark.parametrize(
    "position", [(3.0, 0.0, 0.29), (0.0, -1.0, 0.29), (0.0, 0.0, np.nan), (np.inf, 0.0, 0.0)], ids=str
)
def test_a_wild_pose_is_rejected_and_counted(position):
    rig, calm = Rig(), Rig()
    for tick in range(1000):
        for one in (rig, calm):
            if tick % 50 == 0:
                one.say((0.0, 0.0, 0.29))
        if tick == 700:
            rig.say(position)
        rig.step()
        calm.step()
        if tick == 700:
            age = rig.body.localization_age_ns
            assert age == rig.now_ns - rig.task.state.pose_stamp_ns > 2 * MS
    assert (rig.body.localization_rejected, calm.body.localization_rejected) == (1, 0)
    for name in ("position", "orientation", "linear_velocity"):
        np.testing.assert_array_equal(getattr(rig.body, name), getattr(calm.body, name))


def test_a_pose_is_fused_once():
    rig = Rig()
    for _ in range(100):
        rig.step()
    rig.say((0.03, 0.0, 0.29))
    rig.step()
    once = float(rig.body.position[0])
    for _ in range(5):
        rig.step()
    assert 0.001 < once < 0.03
    assert float(rig.body.position[0]) == pytest.approx(once, abs=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", ["linear_acceleration", "angular_velocity"])
def test_a_sample_that_is_not_finite_is_bridged_and_counted(which, value):
    rig, calm = Rig(), Rig()
    for tick in range(400):
        for one in (rig, calm):
            one.imu.linear_acceleration, one.imu.angular_velocity = (0.0, 0.0, GRAVITY), 0.0
        if tick == 200:
            getattr(rig.imu, which)[1] = value
        rig.step()
        calm.step()
    assert (rig.body.imu_rejected, calm.body.imu_rejected) == (1, 0)
    assert rig.task.save()[:1] == calm.task.save()[:1]
    np.testing.assert_allclose(rig.body.position, calm.body.position, atol=1e-9)
    assert np.isfinite(np.frombuffer(rig.task.state.covariance.tobytes())).all()


def test_a_bad_sample_that_stays_is_counted_once_and_a_good_one_is_used_until_the_next():
    rig = Rig()
    rig.step()
    rig.imu.angular_velocity[0] = np.nan
    rig.step()
    for _ in range(5):
        rig.step(fresh=False)
    assert rig.body.imu_rejected == 1
    rig.imu.angular_velocity = (0.0, 0.0, 0.3)
    rig.step(fresh=False)
    assert rig.body.angular_velocity[2] == pytest.approx(0.0, abs=1e-3), "without a new number it is no new sample"
    rig.step()
    rig.imu.angular_velocity = 0.0
    rig.step(fresh=False)
    assert rig.body.angular_velocity[2] == pytest.approx(0.3, abs=1e-2)


def test_the_first_pose_may_be_nan():
    rig = Rig(position=(np.nan, 0.0, 0.0))
    rig.step()
    assert not rig.task.state.started
    rig.say((0.0, 0.0, 0.29))
    rig.step()
    assert rig.task.state.started
    assert np.isfinite(rig.body.position).all()


def test_without_contact_and_pose_the_trunk_falls_as_the_imu_says():
    rig = Rig()
    rig.step()
    rig.gait.walking, rig.gait.stance = True, False
    rig.imu.linear_acceleration = 0.0
    before = np.array(rig.body.linear_velocity)
    for _ in range(100):
        rig.step()
    np.testing.assert_allclose(rig.body.linear_velocity - before, (0.0, 0.0, -GRAVITY * 0.2), atol=1e-6)


DYNAMICS = LegDynamics(ROBOT)


def support(rig, forces, acceleration=None):
    """Joint efforts of the rig's present motion when the ground pushes its feet with vertical forces (4,)."""
    joints = rig.joints
    legs = LEGS.forward(joints.position, joints.velocity)
    free = DYNAMICS.free_torque(
        rig.imu.linear_acceleration,
        rig.imu.angular_velocity,
        joints.position,
        joints.velocity,
        np.zeros(12) if acceleration is None else acceleration,
    )
    push = np.outer(forces, (0.0, 0.0, 1.0))
    joints.effort = free - np.einsum("fij,fi->fj", legs.jacobian, push).ravel()


def test_the_force_of_each_foot_is_found_from_the_efforts():
    rig, forces = Rig(), np.array([40.0, 25.0, 10.0, 55.0])
    support(rig, forces)
    for _ in range(100):
        rig.step()
    np.testing.assert_allclose(rig.body.contact_force, forces, atol=0.05)


def test_a_leg_that_swings_without_touching_anything_carries_nothing():
    """Its weight and inertia, a knee that accelerates by 300 rad/s^2 and more, are not taken for contact."""
    rig = Rig()
    rig.gait.walking, rig.gait.stance, rig.gait.foot_phase = True, [True, False, False, True], 0.7
    base, largest, raw = rig.joints.position.copy(), 0.0, 0.0
    swinging = np.repeat([False, True, True, False], 3) * np.tile([0.0, 0.6, -1.0], 4)
    for tick in range(300):
        at, rate = tick * 0.002, 18.0
        rig.joints.position = base + 0.5 * np.sin(rate * at) * swinging
        rig.joints.velocity = 0.5 * rate * np.cos(rate * at) * swinging
        # the task's own difference of two samples, so that only its formula is at stake
        before = 0.5 * rate * np.cos(rate * (at - 0.002)) * swinging if tick else 0.0
        support(rig, np.array([62.0, 0.0, 0.0, 62.0]), (rig.joints.velocity - before) / 0.002)
        rig.step()
        if tick > 20:
            largest = max(largest, np.abs(rig.body.contact_force[1:3]).max())
            legs = LEGS.forward(rig.joints.position, rig.joints.velocity)
            raw = max(raw, np.abs(normal_force(legs, rig.joints.effort, np.array([0.0, 0.0, 1.0]))[1:3]).max())
            assert rig.body.contact.tolist() == [True, False, False, True]
    assert largest < 2.0
    assert raw > 10.0, "what the legs themselves need is much"


def test_only_feet_that_are_scheduled_to_stand_are_taken_for_resting():
    """The two in the air are loaded late in their swing and move: the velocity does not follow them."""
    rig, calm = Rig(), Rig()
    for one in (rig, calm):
        one.gait.walking, one.gait.stance, one.gait.foot_phase = True, [True, False, False, True], 0.7
        support(one, np.full(4, 60.0))
    rig.joints.velocity = np.repeat([False, True, True, False], 3) * 1.0
    for _ in range(50):
        rig.step()
        calm.step()
    assert rig.body.contact.all()
    np.testing.assert_allclose(rig.body.linear_velocity, calm.body.linear_velocity, atol=1e-9)


@pytest.mark.parametrize(("slip", "widened"), [(0.03, 1.0), (0.059, 1.0), (0.12, 2.0), (0.6, 10.0)])
def test_a_foot_that_seems_to_slip_is_trusted_less(slip, widened):
    memory = kalman.KalmanMemory("/memory")
    kalman.start(memory, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    memory.velocity = (slip, 0.0, 0.0)
    legs = LEGS.forward(ROBOT.standing_angles(0.29), np.zeros(12))
    measured = kalman.contact_measurement(
        memory.table[0], np.eye(3), np.zeros(3), legs, np.arange(4), np.full(4, 0.03), np.array([0.0, 0.0, 1.0]), RADIUS
    )
    np.testing.assert_allclose(np.sqrt(measured.variance), 0.03 * widened, rtol=1e-9)


def test_the_covariance_stays_symmetric_and_positive():
    rig = Rig()
    walk(rig, 0.6, 4.0, 80 * MS, np.random.default_rng(2))
    covariance = rig.task.state.covariance.reshape(15, 15)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-15)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_outputs_are_of_one_piece():
    rig = Rig(yaw=0.8)
    for _ in range(50):
        rig.step()
    body, rotation = rig.body, rig.rotation
    feet = body.position + LEGS.forward(rig.joints.position, np.zeros(12)).position @ rotation.T
    np.testing.assert_allclose(body.foot_position.reshape(4, 3), feet, atol=1e-9)
    assert body.height == pytest.approx(0.29, abs=1e-3)
    assert np.linalg.norm(body.orientation) == pytest.approx(1.0)
    assert body.contact.all()
    assert body.plane_normal[2] == pytest.approx(1.0, abs=1e-5)


def test_saved_and_restored_it_estimates_the_same():
    one, other = Rig(), Rig()
    for tick in range(300):
        for rig in (one, other):
            if tick % 50 == 0:
                rig.say((0.001 * tick, 0.0, 0.29))
            rig.step()
        other.task.restore(other.task.save())
    assert one.body.to_bytes() == other.body.to_bytes()
    assert one.task.save() == other.task.save()


@pytest.mark.parametrize("shift", [-30 * MS, 200 * MS])
def test_a_sample_out_of_time_is_rejected_and_counted(shift):
    rig = Rig()
    rig.step()
    rig.imu.sequence, rig.imu.stamp_ns = rig.imu.sequence + 1, rig.now_ns + shift
    rig.imu.angular_velocity = (0.0, 0.0, 1.0)
    rig.step(fresh=False)
    assert rig.body.imu_rejected == 1
    assert rig.body.angular_velocity[2] == pytest.approx(0.0, abs=1e-3)


def test_a_spike_is_bridged_and_counted():
    rig = Rig()
    rig.step()
    rig.imu.linear_acceleration = (0.0, 300.0, GRAVITY)
    rig.step()
    assert rig.body.imu_rejected == 1
    assert abs(rig.body.linear_velocity[1]) < 1e-3


def test_the_age_of_the_sample_is_that_of_the_one_that_was_used():
    rig = Rig()
    rig.step()
    assert rig.body.imu_age_ns == 0
    for missing in range(1, 4):
        rig.step(fresh=False)
        assert rig.body.imu_age_ns == missing * PERIOD_NS
    rig.imu.angular_velocity = np.nan
    rig.step()
    assert rig.body.imu_age_ns == 4 * PERIOD_NS


def test_without_samples_a_turn_does_not_go_on():
    rig = Rig()
    rig.imu.angular_velocity = (0.3, 0.0, 0.5)
    for _ in range(3):
        rig.step()
    for _ in range(1000):
        rig.step(fresh=False)
    turned = pin.AngleAxis(pin.Quaternion(np.array(rig.body.orientation))).angle
    assert turned < 0.6 * 1.5 * CONFIG.kalman.longest_step_s


def falling(steps_ns):
    """A body without contacts, stepped at the given intervals, with gravity alone acting."""
    rig = Rig()
    rig.gait.walking = True
    rig.imu.linear_acceleration = (0.0, 0.0, GRAVITY + 1.0)
    rig.step()
    for step_ns in steps_ns:
        rig.now_ns += step_ns - PERIOD_NS
        rig.step()
    return rig.body


def test_a_step_after_skipped_ticks_counts_for_all_of_its_time():
    steady, skipping = falling([PERIOD_NS] * 60), falling([PERIOD_NS] * 40 + [4 * PERIOD_NS] * 5)
    assert skipping.linear_velocity[2] == pytest.approx(steady.linear_velocity[2], rel=0.02)
    assert skipping.position[2] == pytest.approx(steady.position[2], abs=2e-3)


def test_a_long_gap_counts_for_the_longest_step():
    short, long = (
        falling([PERIOD_NS] * 20 + [gap_ns]) for gap_ns in (int(CONFIG.kalman.longest_step_s * 1e9), 3_000 * MS)
    )
    assert long.linear_velocity[2] == pytest.approx(short.linear_velocity[2], rel=1e-6)


def disputed(rig, poses, jump=(4.0, -2.0, 0.0), yaw=0.5, scatter=0.0, rng=None):
    """Poses from elsewhere, ten ticks apart."""
    for _ in range(poses):
        noise = np.zeros(3) if rng is None else scatter * rng.standard_normal(3)
        rig.say(np.array((0.0, 0.0, 0.29)) + jump + noise, yaw)
        for _ in range(10):
            rig.step()


def test_poses_that_agree_on_another_place_are_a_dispute_and_change_nothing():
    rig = Rig()
    rig.step()
    disputed(rig, 25)
    assert rig.body.localization_disputed == 25
    assert rig.body.localization_rejected == 25
    np.testing.assert_allclose(rig.body.position, (0.0, 0.0, 0.29), atol=0.01)
    assert rig.body.localization_age_ns >= 250 * PERIOD_NS


def test_poses_that_agree_on_nothing_are_no_dispute():
    rig, rng = Rig(), np.random.default_rng(1)
    rig.step()
    disputed(rig, 25, scatter=3.0, rng=rng)
    assert rig.body.localization_rejected == 25
    assert rig.body.localization_disputed <= 2


def test_a_pose_that_fits_ends_a_dispute():
    rig = Rig()
    rig.step()
    disputed(rig, 5)
    rig.say((0.0, 0.0, 0.29))
    rig.step()
    assert rig.body.localization_disputed == 0


def test_a_jump_is_no_pose_however_long_there_was_none():
    rig = Rig()
    rig.task.state.covariance = 100.0 * np.eye(kalman.SIZE).ravel()
    rig.step()
    disputed(rig, 1, jump=(CONFIG.kalman.localization_jump_m + 0.1, 0.0, 0.0), yaw=0.0)
    assert rig.body.localization_disputed == 1


@pytest.mark.parametrize("balancing", [False, True])
def test_a_reset_believes_the_localisation_where_the_robot_rests(balancing):
    rig = Rig()
    rig.step()
    disputed(rig, 12)
    rig.operator.reset, rig.gait.balancing = True, balancing
    disputed(rig, 1)
    if balancing:
        np.testing.assert_allclose(rig.body.position, (0.0, 0.0, 0.29), atol=0.01)
        assert rig.body.localization_disputed == 13
        return
    np.testing.assert_allclose(rig.body.position, (4.0, -2.0, 0.29), atol=0.01)
    assert yaw_of_quaternion(np.array(rig.body.orientation)) == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(rig.body.foot_position.reshape(4, 3).mean(axis=0)[:2], (4.0, -2.0), atol=0.05)
    assert rig.body.localization_disputed == 0
    disputed(rig, 5)
    assert rig.body.localization_rejected == 13
    assert rig.body.localization_disputed == 0
