# SPDX-License-Identifier: Apache-2.0
"""The task learns the delay from what was sent and what the wheels do, and only while they are to obey."""

import math
from collections import deque

import numpy as np
import pytest

from runtime.models.vehicle import VehicleGeometry
from runtime.tracking.delay_estimation import DelayConfig
from runtime.tracking.delay_task import DelayTask
from runtime.tracking.vehicle_answer import VehicleAnswer
from runtime.vehicle_signals import CommandDelay, WheelCommand, WheelState

SIZES = {"wheel": 4, "axle_drive": 8, "unit_frame": 6}
PERIOD_NS, GEOMETRY = 20_000_000, VehicleGeometry()
RADIUS_M = GEOMETRY.wheel_radius_m
CONFIG = DelayConfig(initial_s=0.03)
OPPOSITE = np.array([1.0, 1.0, -1.0, -1.0])


class Unit:
    """The task, and wheels that do what was sent some ticks ago."""

    def __init__(self, ticks):
        self.wheels, self.command = WheelState("/wheels", SIZES), WheelCommand("/command", SIZES)
        self.output = CommandDelay("/delay")
        self.task = DelayTask(CONFIG, VehicleAnswer(rate_radps=1.5), GEOMETRY, self.wheels, self.command, self.output)
        self.pending, self.now_ns, self.tick = deque([(0.0, 0.0)] * ticks), 1_000_000_000, 0
        self.command.enable = self.wheels.enabled = True

    def step(self):
        self.task.step(self.now_ns)
        angle, speed = 0.2 * math.sin(0.04 * self.tick), 0.6 * min(1.0, 0.02 * self.tick)
        self.command.stamp_ns = self.now_ns
        self.command.steering, self.command.speed = angle * OPPOSITE, speed / RADIUS_M
        self.pending.append((angle, speed))
        angle, speed = self.pending.popleft()
        self.now_ns, self.tick = self.now_ns + PERIOD_NS, self.tick + 1
        self.wheels.steering, self.wheels.speed = angle * OPPOSITE, speed / RADIUS_M

    def run(self, seconds):
        for _ in range(round(seconds * 1e9 / PERIOD_NS)):
            self.step()


@pytest.mark.parametrize("ticks", [2, 15, 30])
def test_the_delay_of_the_wheels_is_learnt(ticks):
    unit = Unit(ticks)
    unit.run(15.0)
    assert unit.output.stamp_ns == unit.now_ns - PERIOD_NS
    assert unit.output.delay == pytest.approx(0.02 * (ticks + 1), abs=0.03)


@pytest.mark.parametrize("braked", ["command.enable", "wheels.enabled"])
def test_nothing_is_learnt_from_wheels_that_are_not_to_obey(braked):
    unit = Unit(30)
    record, field = braked.split(".")
    setattr(getattr(unit, record), field, False)
    unit.run(10.0)
    assert unit.output.delay == CONFIG.initial_s
    setattr(getattr(unit, record), field, True)
    unit.run(15.0)
    assert unit.output.delay == pytest.approx(0.62, abs=0.03)


def test_a_restored_task_goes_on_as_the_one_that_was_saved():
    unit, other = Unit(15), Unit(15)
    unit.run(4.0)
    other.task.restore(unit.task.save())
    other.wheels.copy_from(unit.wheels)
    other.command.copy_from(unit.command)
    unit.task.step(unit.now_ns)
    other.task.step(unit.now_ns)
    assert other.output.to_bytes() == unit.output.to_bytes()
    assert other.task.save() == unit.task.save()
