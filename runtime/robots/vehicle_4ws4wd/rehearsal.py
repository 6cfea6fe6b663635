# SPDX-License-Identifier: Apache-2.0
"""The vehicle drives in thought, so that what is compiled or loaded at first use is there before it counts.

The loop is stepped on made-up inputs: the wheels obey at once, the IMU feels gravity, and the operator has the vehicle
follow a path and then a velocity. No frame leaves, and nothing that the real loop remembers is touched.
"""

from __future__ import annotations

import numpy as np

from drivers.vcu import UnitMode
from runtime.models.rigid_body import GRAVITY
from runtime.records import Record
from runtime.robots.vehicle_4ws4wd.assembly import assemble
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.signals import Battery, Imu, Mode, Motion, OperatorRequest, Path, Pose, SafetyStatus, Steering
from runtime.tasks import due
from runtime.vehicle_signals import VehicleTruth, WheelCommand, WheelState

BEGIN_NS = 1_000_000_000
DRIVE_AFTER_NS, VELOCITY_AFTER_NS, DURATION_NS = 300_000_000, 900_000_000, 1_200_000_000
SPEED_MPS, GOAL_M = 0.3, 10.0


def rehearse(config: Vehicle4ws4wdConfig) -> bool:
    """Step the loop for a while in virtual time; true if the vehicle came to drive."""
    loop = assemble(config).loops[0]
    scene = _Scene(config)
    drove = False
    for index in range(DURATION_NS // loop.period_ns):
        elapsed_ns = index * loop.period_ns
        for record in loop.port_inputs:
            scene.show(record, elapsed_ns)
        for item in loop.schedule:
            if due(item, index):
                item.task.step(BEGIN_NS + elapsed_ns)
                for record in item.task.writes:
                    scene.show(record, elapsed_ns)
                    drove = drove or (isinstance(record, SafetyStatus) and record.mode == Mode.ACTIVE)
    return drove


class _Scene:
    """What the vehicle is made to believe."""

    def __init__(self, config: Vehicle4ws4wdConfig) -> None:
        self._voltage_v = config.simulation.battery_v
        self._mode, self._enabled, self._steering, self._speed = 0, False, np.zeros(4), np.zeros(4)

    def show(self, record: Record, elapsed_ns: int) -> None:
        """Fill a record that shows the world, or look at the command; any other stays as it is."""
        now_ns = BEGIN_NS + elapsed_ns
        if isinstance(record, WheelCommand):
            self._steering[:], self._speed[:] = record.steering, record.speed
        elif isinstance(record, WheelState):
            record.stamp_ns, record.reply_ns = now_ns, now_ns
            record.mode, record.enabled = UnitMode.DRIVE, True
            record.steering, record.speed, record.temperature = self._steering, self._speed, 25.0
        elif isinstance(record, Imu):
            record.stamp_ns, record.sequence = now_ns, elapsed_ns
            record.linear_acceleration, record.angular_velocity = (0.0, 0.0, GRAVITY), 1e-12 * elapsed_ns
        elif isinstance(record, (Pose, VehicleTruth)):
            record.stamp_ns, record.position = now_ns, (0.0, 0.0, 0.0)
            record.orientation = (0.0, 0.0, 0.0, 1.0)
            if isinstance(record, Pose):
                record.sequence = 1 + elapsed_ns
        elif isinstance(record, Battery):
            record.stamp_ns, record.voltage = now_ns, self._voltage_v
        elif isinstance(record, Path):
            record.stamp_ns, record.count, record.speed = BEGIN_NS, 2, SPEED_MPS
            record.x[:2], record.y[:2] = (0.0, GOAL_M), (0.0, GOAL_M)
        elif isinstance(record, OperatorRequest):
            record.stamp_ns, record.held, record.arm = now_ns, True, elapsed_ns > 0
            record.motion = Motion.WALK if elapsed_ns >= DRIVE_AFTER_NS else Motion.STAND
            if elapsed_ns >= VELOCITY_AFTER_NS:
                record.steering, record.velocity, record.velocity_ns = Steering.VELOCITY, (0.1, 0.1, 0.1), now_ns
