# SPDX-License-Identifier: Apache-2.0
"""The far end of USLGO1's wires: MuJoCo, the virtual drives on the buses, the virtual sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.device_end import Wires
from drivers.dialects import Dialect
from drivers.joints import Joint
from drivers.memory_bus import End, Received
from runtime.models.quadruped import FEET, Quadruped
from runtime.records import Record
from runtime.robots.simulation import SimulationConfig
from runtime.signals import Truth
from sim_bridge.drive_model import DriveModel
from sim_bridge.quadruped_model import build
from sim_bridge.terrain import HeightField
from sim_bridge.virtual_drive import VirtualDrives
from sim_bridge.world import World

Array = npt.NDArray[np.float64]


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


class QuadrupedWorld(World):
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
        drives: the far ends of the buses.
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
        super().__init__(build(description, config, terrain), "trunk", config, terrain, bus, seed)
        self.drives = VirtualDrives(joints, dialect, drive_model(config), self.actuator_seed)
        self._bind_views()
        self._joint_position[:] = joint_angles
        self._set_down(start_pose, height_m)
        self.drives.torque(self._joint_position, self._joint_velocity, 0)
        self._sense(0)

    def _bind_views(self) -> None:
        data = self.data
        self._joint_position, self._joint_velocity = data.qpos[7:], data.qvel[6:]
        self._joint_torque = data.qfrc_applied[6:]
        shanks = [self.model.geom(f"{foot}_foot").bodyid[0] for foot in FEET]
        legs = slice(shanks[0], shanks[-1] + 1, shanks[1] - shanks[0])
        assert list(range(self.model.nbody))[legs] == shanks
        self._shank_force = data.cfrc_ext[legs, 3:]

    def _actuate(self, now_ns: int) -> None:
        self._joint_torque[:] = self.drives.torque(self._joint_position, self._joint_velocity, now_ns)

    def _power(self) -> float:
        return float(self.drives.applied.dot(self._joint_velocity))

    def _talk(self, arrived: Received, now_ns: int) -> None:
        if arrived.bus.size:
            frames, bus, send_ns = self.drives.answer(*arrived)
            self._bus.send(End.DEVICE, bus, frames, send_ns)

    @property
    def joint_angles(self) -> Array:
        """True joint positions, rad; a view."""
        return self._joint_position

    @property
    def joint_velocities(self) -> Array:
        """True joint velocities, rad/s; a view."""
        return self._joint_velocity

    def contact_forces(self) -> Array:
        """Ground reaction on each foot and its shank in the last step, in odom, (4, 3), N; a view.

        MuJoCo sums the contacts of each body for the accelerometer.
        """
        return self._shank_force

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the true state, as an input port."""
        assert isinstance(record, Truth)
        self._read_motion(record, now_ns)
        np.copyto(record.contact_force.reshape(4, 3), self.contact_forces())
        return True
