# SPDX-License-Identifier: Apache-2.0
"""A vehicle that moves as it is told and is known exactly, with the sensors of a real one; for the tests."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from runtime import signals, vehicle_signals
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.estimation.vehicle_filter_task import VehicleFilterTask
from runtime.models.inertial import InertialConfig
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import quaternion_of_yaw, roll_pitch_yaw, wrapped

SIZES = {"wheel": 4, "axle_drive": 8, "unit_frame": 4}
POSITIONS = np.array([[0.585, 0.37], [0.585, -0.37], [-0.585, 0.37], [-0.585, -0.37]])
PLACES = POSITIONS.tolist()
RADIUS = 0.2
MS, PERIOD_NS = 1_000_000, 10_000_000
EXACT = {"imu": 0.0, "wheels": 0.0, "position": 0.0, "yaw": 0.0, "bias": 0.0}
NOISY = {"imu": 1.0, "wheels": 0.02, "position": 0.02, "yaw": 0.0087266, "bias": 1.0}
"""Of `SimulationConfig`: the IMU's densities and biases as shares of its defaults, wheels in rad/s."""


def wheels_for(twist):
    """Angles within 90 degrees and signed speeds of four wheels that roll (FORMULAS, paper 002)."""
    vx, vy, w = map(float, twist)
    angles, speeds = [], []
    for x, y in PLACES:
        forward, left = vx - w * y, vy + w * x
        angle, speed = math.atan2(left, forward), math.hypot(forward, left) / RADIUS
        if abs(angle) > math.pi / 2:
            angle, speed = angle - math.copysign(math.pi, angle), -speed
        angles.append(angle)
        speeds.append(speed)
    return np.array(angles), np.array(speeds)


def rpy_matrix(roll, pitch, yaw):
    """R = Rz Ry Rx."""
    c, s = np.cos, np.sin
    z = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    y = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    x = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    return z @ y @ x


@pytest.fixture(scope="session")
def vehicle():
    """Where the wheels of the vehicle are, their radius, and what they do at a twist."""
    return SimpleNamespace(positions=POSITIONS, radius=RADIUS, wheels_for=wheels_for)


@pytest.fixture(scope="session")
def drive():
    """`Drive`, whose parameters are those of one drive."""
    return Drive


@pytest.fixture(scope="session")
def figure_eight():
    """Twists along a Bernoulli lemniscate."""
    return lemniscate


class Drive:
    """The estimator, and a truth whose twist in base is set before each step.

    The truth drives on a plane of a given tilt; `slope` turns the horizontal plane into it.
    """

    def __init__(self, noise=EXACT, seed=0, config=None, slope=(0.0, 0.0), late_ns=80 * MS, yaw=0.0, every_ns=100 * MS):
        self.config = VehicleFilterConfig() if config is None else config
        self.noise, self.rng, self.late_ns, self.every_ns = noise, np.random.default_rng(seed), late_ns, every_ns
        self.slope = rpy_matrix(*slope, 0.0)
        self.gravity = (GRAVITY * self.slope[2]).tolist()  # of the plane's axes
        self.plane, self.twist, self.now_ns = (0.0, 0.0, yaw), np.zeros(3), 1000 * MS
        self.spread = noise["imu"] * np.sqrt(500.0) * np.repeat((0.003, 0.0003), 3)
        self.bias = noise["bias"] * self.rng.standard_normal(6) * np.repeat((0.05, 0.003), 3)
        self.imu, self.pose = signals.Imu("/imu"), signals.Pose("/pose")
        self.wheels = vehicle_signals.WheelState("/wheels", SIZES)
        self.operator = signals.OperatorRequest("/operator")
        self.state = vehicle_signals.VehicleState("/state", SIZES)
        records = self.imu, self.wheels, self.pose, self.operator, self.state
        self.task = VehicleFilterTask(POSITIONS, RADIUS, range(4), self.config, InertialConfig(), PERIOD_NS, *records)
        self.pending, self.localized, self.spin, self.travelled = [], True, np.zeros(4), 0.0
        self.broken = None

    @property
    def rotation(self):
        """Of base in odom."""
        return self.slope @ rpy_matrix(0.0, 0.0, self.plane[2])

    @property
    def position(self):
        """Of base in odom."""
        return self.slope @ (self.plane[0], self.plane[1], 0.0)

    @property
    def yaw(self):
        """Of base in odom."""
        return roll_pitch_yaw(self.rotation)[2]

    def step(self, twist, seconds=0.01, measured=True, felt=True):
        """Move for a time, with an inertial sample or without, and estimate unless the tick is skipped."""
        before, self.twist = self.twist, np.array(twist, dtype=np.float64)
        vx, vy, w = (0.5 * (before + self.twist)).tolist()
        x, y, yaw = self.plane
        c, s = math.cos(yaw + 0.5 * seconds * w), math.sin(yaw + 0.5 * seconds * w)
        self.plane = x + seconds * (c * vx - s * vy), y + seconds * (s * vx + c * vy), yaw + seconds * w
        self.travelled += seconds * math.hypot(vx, vy)
        self.now_ns += round(seconds * 1e9)
        if felt:
            self.feel(*((self.twist - before) / seconds).tolist()[:2])
        self.roll()
        self.localize()
        if measured:
            self.task.step(self.now_ns)

    def feel(self, forward, left):
        """An inertial sample in which the twist grows at these rates: means of the densities at 500 Hz."""
        vx, vy, w = self.twist.tolist()
        c, s = math.cos(self.plane[2]), math.sin(self.plane[2])
        gx, gy, gz = self.gravity
        exact = forward - w * vy + c * gx + s * gy, left + w * vx - s * gx + c * gy, gz, 0.0, 0.0, w
        sample = np.array(exact) + self.bias + self.spread * self.rng.standard_normal(6)
        self.imu.linear_acceleration, self.imu.angular_velocity = sample[:3], sample[3:]
        self.imu.stamp_ns = self.now_ns
        self.imu.sequence += 1

    def roll(self):
        """The wheels' state."""
        steering, speed = wheels_for(self.twist)
        self.wheels.steering = steering
        self.wheels.speed = speed + self.noise["wheels"] * self.rng.standard_normal(4) + self.spin
        self.wheels.reply_ns[:] = self.now_ns
        if self.broken is not None:
            self.break_wheel(*self.broken)
        self.wheels.stamp_ns = self.now_ns

    def break_wheel(self, how, wheel):
        """Let a wheel say what must not be gone by."""
        self.wheels.speed[wheel], self.wheels.steering[wheel] = 5.0, 1.0
        if how == "old":
            self.wheels.reply_ns[wheel] = 9_000 * MS
        elif how == "nan":
            self.wheels.speed[wheel] = np.nan
        else:
            self.wheels.fault[wheel] = 5

    def localize(self):
        """Acquire a pose where one is due, and deliver those that are late enough."""
        if self.now_ns % self.every_ns == 0 and self.localized:
            position = self.position + self.noise["position"] * self.rng.standard_normal(3)
            self.pending.append((self.now_ns, position, self.yaw + self.noise["yaw"] * self.rng.standard_normal()))
        while self.pending and self.pending[0][0] + self.late_ns <= self.now_ns:
            self.say(*self.pending.pop(0))

    def say(self, stamp_ns, position, yaw):
        """A pose of the localisation sensor."""
        self.pose.stamp_ns, self.pose.position, self.pose.orientation = stamp_ns, position, quaternion_of_yaw(yaw)
        self.pose.sequence += 1

    @property
    def position_error(self):
        """Estimate less truth in odom."""
        return self.state.position - self.position

    @property
    def yaw_error(self):
        """Estimate less truth."""
        x, y, z, w = self.state.orientation
        return wrapped(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) - self.yaw)


def lemniscate(speed, seconds, half_width=8.0):
    """Twists along a Bernoulli lemniscate of a = 8 m after standing for 2 s, speeding up within 2 s, at 100 Hz."""
    parameter = 0.0
    for tick in range(round(seconds * 100)):
        along = speed * min(1.0, max(0.0, tick / 100 - 2.0) / 2.0)
        s, c = math.sin(parameter), math.cos(parameter)
        curvature = 3.0 * c / (half_width * math.sqrt(1.0 + s * s))
        parameter += along * 0.01 * math.sqrt(1.0 + s * s) / half_width
        yield along, 0.0, along * curvature
