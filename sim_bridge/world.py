# SPDX-License-Identifier: Apache-2.0
"""What the worlds of all simulated robots have in common: a body afloat, its sensors, and what disturbs it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import mujoco
import numpy as np
import numpy.typing as npt

from drivers.device_end import Wires
from drivers.memory_bus import End, Received
from runtime.models.rotations import quaternion_of_yaw
from runtime.records import Record
from runtime.robots.simulation import WorldConfig
from runtime.signals import Truth
from runtime.vehicle_signals import VehicleTruth
from sim_bridge.sensors import BatterySensor, InertialSensor, LocalizationSensor
from sim_bridge.terrain import HeightField

Array = npt.NDArray[np.float64]
WXYZ_TO_XYZW = [1, 2, 3, 0]
POWER_PERIOD_NS = 10_000_000
"""How often the power of the motors is looked at; it then counts for that long."""
DROP_M = 0.002
"""Height from which the robot is set down."""


class World(ABC):
    """Physics, actuators and sensors of one robot, advanced in virtual time.

    Args:
        model: of MuJoCo; its first joint is free, its first six sensor values are the IMU's.
        body: name of the body on that joint.
        config: physics and sensors.
        terrain: the ground, or None for a plane.
        bus: the wires to the runtime.
        seed: of every noise.

    Attributes:
        model, data: MuJoCo's.
        imu, localization, battery: the far ends.
        actuator_seed: of the noise of what the subclass adds.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        body: str,
        config: WorldConfig,
        terrain: HeightField | None,
        bus: Wires,
        seed: int,
    ) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self._terrain, self._bus = terrain, bus
        self._step_ns, self._now_ns = config.time_step_ns, 0
        noise = np.random.SeedSequence(seed).spawn(3)
        imu_noise, pose_noise = (np.random.Generator(np.random.PCG64(sequence)) for sequence in noise[:2])
        self.actuator_seed = int(noise[2].generate_state(1)[0])
        self.imu = InertialSensor(config, imu_noise)
        self.localization = LocalizationSensor(config, pose_noise)
        self.battery = BatterySensor(config)
        self._push: tuple[int, int, Array] | None = None
        self._body = model.body(body).id
        data = self.data  # MuJoCo's arrays stay where they are; looking one up costs more than a copy of it
        self._position, self._quaternion_wxyz = data.qpos[:3], data.qpos[3:7]
        self._place, self._quaternion_xyz = data.qpos[:7], data.qpos[4:7]
        self._linear_velocity, self._angular_velocity = data.qvel[:3], data.qvel[3:6]
        self._motion = data.sensordata[:6]

    def _set_down(self, start_pose: tuple[float, float, float], height_m: float) -> None:
        """Put the body level at x, y, yaw, its origin at a height above the ground there."""
        x, y, yaw = start_pose
        qx, qy, qz, qw = quaternion_of_yaw(yaw)
        ground = 0.0 if self._terrain is None else self._terrain.height_at(x, y)
        self._place[:] = (x, y, ground + height_m + DROP_M, qw, qx, qy, qz)
        mujoco.mj_forward(self.model, self.data)

    # -- what a robot adds ----------------------------------------------------------------------------------------

    @abstractmethod
    def _actuate(self, now_ns: int) -> None:
        """Set the forces of all actuators for the next step."""

    @abstractmethod
    def _power(self) -> float:
        """What the motors draw mechanically, W; negative if they are driven."""

    @abstractmethod
    def _talk(self, arrived: Received, now_ns: int) -> None:
        """Take the frames that arrived, and send what is to be sent."""

    # -- time -----------------------------------------------------------------------------------------------------

    def advance(self, until_ns: int) -> None:
        """Step the physics up to a time, and take and give frames meanwhile."""
        while self._now_ns + self._step_ns <= until_ns:
            self._step()

    def _step(self) -> None:
        now_ns = self._now_ns
        self._actuate(now_ns)
        if self._push is not None:
            self._apply_push(now_ns)
        mujoco.mj_step(self.model, self.data)
        self._now_ns = now_ns = now_ns + self._step_ns
        if now_ns % POWER_PERIOD_NS == 0:
            self.battery.drain(self._power(), POWER_PERIOD_NS * 1e-9)
        self.imu.feel(self._motion, now_ns)
        self._sense(now_ns)
        self._talk(self._bus.receive(End.DEVICE, now_ns), now_ns)

    def _sense(self, now_ns: int) -> None:
        if self.localization.due(now_ns):
            self.localization.see(self._position, self._quaternion_wxyz[WXYZ_TO_XYZW], now_ns)

    # -- disturbances ---------------------------------------------------------------------------------------------

    def push(self, begin_ns: int, duration_ns: int, direction_rad: float, force_n: float) -> None:
        """Push the body at its centre of mass; the direction is relative to its present yaw and then stays."""
        angle = self.yaw + direction_rad
        wrench = force_n * np.array([math.cos(angle), math.sin(angle), 0.0, 0.0, 0.0, 0.0])
        self._push = begin_ns, begin_ns + duration_ns, wrench

    def roll(self, begin_ns: int, duration_ns: int, moment_nm: float) -> None:
        """Turn the body about its present forward axis, to the right if the moment is positive."""
        wrench = moment_nm * np.array([0.0, 0.0, 0.0, math.cos(self.yaw), math.sin(self.yaw), 0.0])
        self._push = begin_ns, begin_ns + duration_ns, wrench

    def _apply_push(self, now_ns: int) -> None:
        assert self._push is not None
        begin_ns, end_ns, wrench = self._push
        self.data.xfrc_applied[self._body] = wrench if begin_ns <= now_ns < end_ns else 0.0

    # -- truth ----------------------------------------------------------------------------------------------------

    @property
    def position(self) -> Array:
        """True origin of the body, m."""
        return self._position.copy()

    @property
    def yaw(self) -> float:
        """True yaw, rad."""
        w, x, y, z = self._quaternion_wxyz.tolist()
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def tilt(self) -> float:
        """True angle between the body's z axis and the vertical, rad."""
        _, x, y, _ = self._quaternion_wxyz.tolist()
        return math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y))))

    @property
    def clearance(self) -> float:
        """True height of the body's origin above the ground below it, m."""
        x, y, z = self._position.tolist()
        return z - (0.0 if self._terrain is None else self._terrain.height_at(x, y))

    @abstractmethod
    def read(self, record: Record, now_ns: int) -> bool:
        """Give the true state, as an input port."""

    def _read_motion(self, record: Truth | VehicleTruth, now_ns: int) -> None:
        """Fill in what all robots have."""
        record.stamp_ns = now_ns
        record.position, orientation = self._position, record.orientation
        orientation[:3], orientation[3] = self._quaternion_xyz, self._quaternion_wxyz[0]
        record.linear_velocity, record.angular_velocity = self._linear_velocity, self._angular_velocity
