# SPDX-License-Identifier: Apache-2.0
"""The far end of USLGO1's wires: MuJoCo, the virtual drives on the buses, the virtual sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
import numpy.typing as npt

from drivers.device_end import Wires
from drivers.dialects import Dialect
from drivers.joints import Joint
from drivers.memory_bus import End
from runtime.models.quadruped import FEET, Quadruped
from runtime.models.rotations import quaternion_of_yaw
from runtime.records import Record
from runtime.robots.simulation import SimulationConfig
from runtime.signals import Truth
from sim_bridge.drive_model import DriveModel
from sim_bridge.quadruped_model import build
from sim_bridge.sensors import BatterySensor, InertialSensor, LocalizationSensor
from sim_bridge.terrain import HeightField
from sim_bridge.virtual_drive import VirtualDrives

Array = npt.NDArray[np.float64]
WXYZ_TO_XYZW = [1, 2, 3, 0]
POWER_PERIOD_NS = 10_000_000
"""How often the power of the motors is looked at; it then counts for that long."""
DROP_M = 0.002
"""Height from which the robot is set down."""


def drive_model(config: SimulationConfig) -> DriveModel:
    """The virtual drives' physics and firmware."""
    return DriveModel(
        peak_torque=config.peak_torque_nm,
        no_load_speed=config.no_load_speed_radps,
        encoder_counts=config.encoder_counts,
        velocity_noise=config.velocity_noise_radps,
        command_timeout_ns=config.command_timeout_ns,
        timeout_damping=config.timeout_damping_nms_prad,
        ambient_temperature=config.ambient_degc,
        heating=config.heating_k_ps_pnm2,
        cooling_time=config.cooling_s,
        temperature_limit=config.drive_limit_degc,
        bus_voltage=config.battery_v,
    )


class QuadrupedWorld:
    """Physics, drives and sensors, advanced in virtual time.

    Args:
        description: geometry and masses.
        config: physics, drives, sensors.
        joints, dialect: of the drives.
        terrain: the ground, or None for a plane.
        bus: the wires to the runtime.
        seed: of every noise.
        start_pose: x, y, yaw.
        joint_angles: at the start.
        height_m: of the trunk origin above the ground at the start.

    Attributes:
        model, data: MuJoCo's.
        drives, imu, localization, battery: the far ends.
    """

    def __init__(
        self,
        description: Quadruped,
        config: SimulationConfig,
        joints: Sequence[Joint],
        dialect: Dialect,
        terrain: HeightField | None,
        bus: Wires,
        seed: int,
        start_pose: tuple[float, float, float],
        joint_angles: Array,
        height_m: float,
    ) -> None:
        self.model = build(description, config, terrain)
        self.data = mujoco.MjData(self.model)
        self._terrain, self._bus = terrain, bus
        self._step_ns, self._now_ns = config.time_step_ns, 0
        noise = np.random.SeedSequence(seed).spawn(3)
        imu_noise, pose_noise = (np.random.Generator(np.random.PCG64(sequence)) for sequence in noise[:2])
        self.drives = VirtualDrives(joints, dialect, drive_model(config), int(noise[2].generate_state(1)[0]))
        self.imu = InertialSensor(config, imu_noise)
        self.localization = LocalizationSensor(config, pose_noise)
        self.battery = BatterySensor(config)
        self._push: tuple[int, int, Array] | None = None
        self._trunk = self.model.body("trunk").id
        self._bind_views()
        self._settle(start_pose, joint_angles, height_m)

    def _settle(self, start_pose: tuple[float, float, float], joint_angles: Array, height_m: float) -> None:
        x, y, yaw = start_pose
        qx, qy, qz, qw = quaternion_of_yaw(yaw)
        ground = 0.0 if self._terrain is None else self._terrain.height_at(x, y)
        self._place[:] = (x, y, ground + height_m + DROP_M, qw, qx, qy, qz)
        self._joint_position[:] = joint_angles
        mujoco.mj_forward(self.model, self.data)
        self.drives.torque(self._joint_position, self._joint_velocity, 0)
        self._sense(0)

    def _bind_views(self) -> None:
        """MuJoCo's arrays stay where they are; looking one up costs more than a copy of it."""
        data = self.data
        self._place, self._joint_position, self._joint_velocity = data.qpos[:7], data.qpos[7:], data.qvel[6:]
        self._position, self._quaternion_wxyz = data.qpos[:3], data.qpos[3:7]
        self._quaternion_xyz = data.qpos[4:7]
        self._linear_velocity, self._angular_velocity = data.qvel[:3], data.qvel[3:6]
        self._joint_torque, self._motion = data.qfrc_applied[6:], data.sensordata[:6]
        shanks = [self.model.geom(f"{foot}_foot").bodyid[0] for foot in FEET]
        legs = slice(shanks[0], shanks[-1] + 1, shanks[1] - shanks[0])
        assert list(range(self.model.nbody))[legs] == shanks
        self._shank_force = data.cfrc_ext[legs, 3:]

    # -- time -----------------------------------------------------------------------------------------------------

    def advance(self, until_ns: int) -> None:
        """Step the physics up to a time, and answer the frames that arrive meanwhile."""
        while self._now_ns + self._step_ns <= until_ns:
            self._step()

    def _step(self) -> None:
        now_ns = self._now_ns
        torque = self.drives.torque(self._joint_position, self._joint_velocity, now_ns)
        self._joint_torque[:] = torque
        if self._push is not None:
            self._apply_push(now_ns)
        mujoco.mj_step(self.model, self.data)
        self._now_ns = now_ns = now_ns + self._step_ns
        if now_ns % POWER_PERIOD_NS == 0:
            self.battery.drain(float(torque.dot(self._joint_velocity)), POWER_PERIOD_NS * 1e-9)
        self.imu.feel(self._motion, now_ns)
        self._sense(now_ns)
        arrived = self._bus.receive(End.DEVICE, now_ns)
        if arrived.bus.size:
            frames, bus, send_ns = self.drives.answer(*arrived)
            self._bus.send(End.DEVICE, bus, frames, send_ns)

    def _sense(self, now_ns: int) -> None:
        if self.localization.due(now_ns):
            self.localization.see(self._position, self._quaternion_wxyz[WXYZ_TO_XYZW], now_ns)

    # -- disturbances ---------------------------------------------------------------------------------------------

    def push(self, begin_ns: int, duration_ns: int, direction_rad: float, force_n: float) -> None:
        """Push the trunk at its centre of mass; the direction is relative to its present yaw and then stays."""
        angle = self.yaw + direction_rad
        wrench = force_n * np.array([math.cos(angle), math.sin(angle), 0.0, 0.0, 0.0, 0.0])
        self._push = begin_ns, begin_ns + duration_ns, wrench

    def roll(self, begin_ns: int, duration_ns: int, moment_nm: float) -> None:
        """Turn the trunk about its present forward axis, to the right if the moment is positive."""
        wrench = moment_nm * np.array([0.0, 0.0, 0.0, math.cos(self.yaw), math.sin(self.yaw), 0.0])
        self._push = begin_ns, begin_ns + duration_ns, wrench

    def _apply_push(self, now_ns: int) -> None:
        assert self._push is not None
        begin_ns, end_ns, wrench = self._push
        self.data.xfrc_applied[self._trunk] = wrench if begin_ns <= now_ns < end_ns else 0.0

    # -- truth ----------------------------------------------------------------------------------------------------

    @property
    def position(self) -> Array:
        """True trunk origin, m."""
        return self._position.copy()

    @property
    def yaw(self) -> float:
        """True yaw, rad."""
        w, x, y, z = self._quaternion_wxyz.tolist()
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def joint_angles(self) -> Array:
        """True joint positions, rad; a view."""
        return self._joint_position

    @property
    def tilt(self) -> float:
        """True angle between the trunk's z axis and the vertical, rad."""
        _, x, y, _ = self._quaternion_wxyz.tolist()
        return math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y))))

    @property
    def clearance(self) -> float:
        """True height of the trunk origin above the ground below it, m."""
        x, y, z = self._position.tolist()
        return z - (0.0 if self._terrain is None else self._terrain.height_at(x, y))

    def contact_forces(self) -> Array:
        """Ground reaction on each foot and its shank in the last step, in odom, (4, 3), N; a view.

        MuJoCo sums the contacts of each body for the accelerometer.
        """
        return self._shank_force

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the true state, as an input port."""
        assert isinstance(record, Truth)
        record.stamp_ns = now_ns
        record.position, orientation = self._position, record.orientation
        orientation[:3], orientation[3] = self._quaternion_xyz, self._quaternion_wxyz[0]
        record.linear_velocity, record.angular_velocity = self._linear_velocity, self._angular_velocity
        np.copyto(record.contact_force.reshape(4, 3), self.contact_forces())
        return True
