# SPDX-License-Identifier: Apache-2.0
"""The steering task asks of every wheel what the motion of the centre needs, and goes on after a restart as before."""

import numpy as np
import pytest

from runtime.models.vehicle import VehicleGeometry
from runtime.vehicle_signals import SteeringMode, TwistCommand, WheelCommand, WheelState
from runtime.wheeled.steering import Twist, wheel_targets
from runtime.wheeled.steering_sequence import Phase, SteeringLimits
from runtime.wheeled.steering_task import SteeringTask

SIZES = {"wheel": 4, "axle_drive": 8, "unit_frame": 6}
PERIOD_NS, DRIVE = 10_000_000, 1
GEOMETRY = VehicleGeometry()


class Wheels:
    """The task, and wheels that are at once where they are wanted."""

    def __init__(self):
        self.twist, self.wheels = TwistCommand("/twist"), WheelState("/wheels", SIZES)
        self.command = WheelCommand("/command", SIZES)
        self.task = SteeringTask(GEOMETRY, SteeringLimits(), DRIVE, PERIOD_NS, self.twist, self.wheels, self.command)
        self.now_ns, self.wheels.stamp_ns = 0, 1

    def drive(self, forward, lateral, yaw_rate, manner, steps=200):
        self.twist.velocity, self.twist.yaw_rate, self.twist.manner = (forward, lateral), yaw_rate, manner
        for _ in range(steps):
            self.now_ns += PERIOD_NS
            self.task.step(self.now_ns)
            self.wheels.steering, self.wheels.speed = self.command.steering, self.command.speed


@pytest.fixture
def wheels():
    return Wheels()


@pytest.mark.parametrize(
    ("motion", "manner"),
    [
        ((0.6, 0.0, 0.3), SteeringMode.ACKERMANN),
        ((-0.6, 0.0, 0.3), SteeringMode.ACKERMANN),
        ((0.0, 0.4, 0.0), SteeringMode.CRAB),
        ((0.3, 0.3, 0.0), SteeringMode.CRAB),
        ((0.0, 0.0, 0.5), SteeringMode.SPIN),
        ((0.3, 0.2, 0.2), SteeringMode.FREE),
    ],
)
def test_each_way_of_steering_is_reached(wheels, motion, manner):
    wheels.drive(*motion, manner)
    wanted = wheel_targets(Twist(*motion), GEOMETRY, wheels.command.steering.tolist())
    assert wheels.command.phase == Phase.ROLLING
    assert wheels.command.manner == manner
    assert wheels.command.steering == pytest.approx(np.array(wanted.steering))
    assert wheels.command.speed == pytest.approx(np.array(wanted.speed))


def test_nothing_is_asked_before_the_wheels_are_heard(wheels):
    wheels.wheels.stamp_ns = 0
    wheels.drive(0.6, 0.0, 0.0, SteeringMode.ACKERMANN)
    assert wheels.command.stamp_ns == 0
    assert not wheels.command.enable


def test_a_motion_that_is_no_number_leaves_the_wheels_standing(wheels):
    wheels.drive(0.6, 0.0, 0.3, SteeringMode.ACKERMANN)
    wheels.drive(float("nan"), 0.0, 0.3, SteeringMode.ACKERMANN, steps=1)
    assert not wheels.command.speed.any()
    assert np.isfinite(wheels.command.steering).all()


def test_a_restored_task_goes_on_as_the_one_that_was_saved(wheels):
    wheels.drive(0.6, 0.0, 0.3, SteeringMode.ACKERMANN, steps=20)
    wheels.drive(0.0, 0.4, 0.0, SteeringMode.CRAB, steps=5)
    saved, measured = wheels.task.save(), wheels.wheels.to_bytes()
    wheels.now_ns += PERIOD_NS
    wheels.task.step(wheels.now_ns)
    other = Wheels()
    other.twist.copy_from(wheels.twist)
    other.wheels.load(measured)
    other.task.restore(saved)
    other.task.step(wheels.now_ns)
    assert other.command.to_bytes() == wheels.command.to_bytes()
