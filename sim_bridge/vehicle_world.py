# SPDX-License-Identifier: Apache-2.0
"""The far end of the vehicle's wires: MuJoCo, the virtual control unit on its bus, the virtual sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.device_end import Wires
from drivers.memory_bus import End, Received
from drivers.vcu_database import UnitDatabase
from runtime.models.rotations import matrix_of_quaternion
from runtime.models.vehicle import WHEELS, Vehicle
from runtime.records import Record
from runtime.robots.vehicle_simulation import VehicleSimulationConfig
from runtime.vehicle_signals import VehicleTruth
from sim_bridge.ground_friction import FrictionPatch, friction_at
from sim_bridge.terrain import HeightField
from sim_bridge.vehicle_model import WHEEL_JOINTS, build
from sim_bridge.vehicle_motors import DRIVING, STEERING
from sim_bridge.virtual_unit import VirtualUnit
from sim_bridge.world import World

Array = npt.NDArray[np.float64]
COUNT = len(WHEELS)
LEAST_SPEED_MPS = 0.05
"""Below this a wheel's slip ratio is that to this speed."""


class VehicleWorld(World):
    """Physics, control unit and sensors, advanced in virtual time.

    Args:
        description: geometry and masses.
        config: physics, motors, control unit, sensors.
        database: of the control unit's frames.
        terrain: the ground, or None for a plane.
        bus: the wires to the runtime.
        seed: of every noise.
        start_pose: x, y, yaw.
        patches: of ground with a friction of its own.
        unit_bus: index of the control unit's bus.

    Attributes:
        unit: the far end of the bus.
    """

    def __init__(
        self,
        description: Vehicle,
        config: VehicleSimulationConfig,
        database: UnitDatabase,
        terrain: HeightField | None,
        bus: Wires,
        seed: int,
        start_pose: tuple[float, float, float],
        patches: Sequence[FrictionPatch] = (),
        unit_bus: int = 0,
    ) -> None:
        super().__init__(build(description, config, terrain), "chassis", config, terrain, bus, seed)
        self._description, self._config, self._patches = description, config, tuple(patches)
        self.unit = VirtualUnit(description, config, database, unit_bus, self.battery, self.actuator_seed)
        self._unit_bus = unit_bus
        self._bind_views()
        self._set_down(start_pose, 0.0)
        self._sense(0)

    def _bind_views(self) -> None:
        data, model, shape = self.data, self.model, (COUNT, WHEEL_JOINTS)
        self._joint_position, self._joint_velocity = data.qpos[7:].reshape(shape), data.qvel[6:].reshape(shape)
        self._motor_torque = data.qfrc_applied[6:].reshape(shape)[:, STEERING:]
        self._joint_friction = model.dof_frictionloss[6:].reshape(shape)[:, STEERING:]
        self._tyres = [model.geom(f"{wheel}_tyre").id for wheel in WHEELS]

    def _actuate(self, now_ns: int) -> None:
        self._motor_torque[:] = self.unit.drive(self._joint_position, self._joint_velocity, now_ns)
        self._joint_friction[:] = self.unit.friction
        if self._patches:
            x, y, _ = self.data.geom_xpos[self._tyres].T
            self.model.geom_friction[self._tyres, 0] = friction_at(x, y, self._patches, self._config.terrain_friction)

    def _power(self) -> float:
        return float((self._motor_torque * self._joint_velocity[:, STEERING:]).sum())

    def _talk(self, arrived: Received, now_ns: int) -> None:
        if arrived.bus.size:
            self.unit.receive(*arrived)
        frames = self.unit.report(self._joint_position, self._joint_velocity, now_ns)
        if frames.size:
            self._bus.send(End.DEVICE, np.full(frames.size, self._unit_bus, np.uint8), frames, now_ns)

    # -- truth ----------------------------------------------------------------------------------------------------

    @property
    def steering_angles(self) -> Array:
        """True steering angles (4,), rad; a view."""
        return self._joint_position[:, STEERING]

    @property
    def wheel_speeds(self) -> Array:
        """True speeds of the wheels about their axles (4,), rad/s; a view."""
        return self._joint_velocity[:, DRIVING]

    def ground_velocities(self) -> Array:
        """Velocity over the ground of each wheel's place, in base, (4, 2), m/s."""
        rotation = matrix_of_quaternion(self._quaternion_wxyz[[1, 2, 3, 0]])
        forward, left, _ = rotation.T @ self._linear_velocity
        x, y = self._description.wheel_positions().T
        yaw_rate = self._angular_velocity[2]
        return np.stack((forward - yaw_rate * y, left + yaw_rate * x), axis=1)

    def slip_ratios(self) -> Array:
        """Slip of each wheel along its heading: (rolling speed - ground speed) / the larger of both, (4,)."""
        angles = self.steering_angles
        heading = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        ground = (self.ground_velocities() * heading).sum(axis=1)
        rolling = self._description.wheel_radius_m * self.wheel_speeds
        larger = np.maximum(np.maximum(np.abs(rolling), np.abs(ground)), LEAST_SPEED_MPS)
        return np.asarray((rolling - ground) / larger)

    def loads(self) -> Array:
        """Normal force of the ground on each wheel in the last step, (4,), N."""
        contact, forces = self.data.contact, np.zeros(COUNT)
        for geoms, row in zip(contact.geom, contact.efc_address, strict=True):
            for wheel, tyre in enumerate(self._tyres):
                if tyre in geoms and row >= 0:
                    forces[wheel] += self.data.efc_force[row]
        return forces

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the true state, as an input port."""
        assert isinstance(record, VehicleTruth)
        self._read_motion(record, now_ns)
        record.steering, record.speed = self.steering_angles, self.wheel_speeds
        record.slip, record.normal_force = self.slip_ratios(), self.loads()
        return True
