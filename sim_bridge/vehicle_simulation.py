# SPDX-License-Identifier: Apache-2.0
"""A vehicle on four steered and driven wheels in simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from drivers.device_end import Wires
from runtime.executors.loop_run import InputPort
from runtime.models.vehicle import WHEELS
from runtime.recording.stalls import StallBound
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.vehicle_4ws4wd.assembly import PATH_CAPACITY
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.signals import OperatorRequest, Steering
from runtime.tracking.path_csv import read_path_csv
from runtime.tracking.waypoints import check_cusped_waypoints
from runtime.vehicle_signals import TwistCommand
from sim_bridge.drive_script import ScriptedDriver
from sim_bridge.scenario import Push, Scenario
from sim_bridge.script import ScriptedOperator
from sim_bridge.terrain import HeightField
from sim_bridge.vehicle_courses import custom, scenario
from sim_bridge.vehicle_stall_bounds import vehicle_bounds
from sim_bridge.vehicle_world import VehicleWorld
from sim_bridge.world import World


class VehicleSimulation:
    """See `sim_bridge.simulation.Simulation`."""

    warm_up, warm_up_ns = "flat", 1_500_000_000
    fallen_clearance_m = -math.inf
    watched = (topics.WHEEL_STATUS,)

    def __init__(self, config: Vehicle4ws4wdConfig) -> None:
        self._config, self.step_ns = config, config.simulation.time_step_ns

    def scenario(self, name: str, seed: int) -> Scenario:
        """The scenario of a name; the seed of `curve` counts through the shapes."""
        is_file = name.lower().endswith(".csv")
        if is_file:
            chosen = custom(read_path_csv(name, capacity=PATH_CAPACITY, check=check_cusped_waypoints))
        else:
            chosen = scenario(name, seed)
        speed_mps = self._config.scenario.speed_mps
        followed = chosen.waypoints and chosen.velocity is None
        return chosen.with_speed(speed_mps) if speed_mps > 0.0 and followed else chosen

    def world(self, course: Scenario, terrain: HeightField, wires: Wires, seed: int) -> VehicleWorld:
        """The vehicle at the start of a scenario."""
        config = self._config
        return VehicleWorld(
            config.vehicle,
            config.simulation,
            config.drives.unit().database,
            terrain,
            wires,
            seed,
            course.start_pose,
            course.patches,
        )

    def sensors(self, world: World) -> Mapping[str, InputPort]:
        """IMU and localisation; the battery is the control unit's to tell."""
        assert isinstance(world, VehicleWorld)
        return {topics.IMU: world.imu, topics.LOCALIZATION: world.localization}

    def operator(self, course: Scenario, world: World) -> InputPort:
        """Has the vehicle follow the path, or steers it by velocity."""
        if course.velocity is None:
            return ScriptedOperator(course, 0.0)
        limits = self._config.tracker.following.speed
        late_s = self._config.delay.initial_s + self._config.simulation.command_delay_ns * 1e-9
        forward, lateral, yaw_rate = map(abs, course.velocity)
        braking_s = max(max(forward, lateral) / limits.deceleration_mps2, yaw_rate / limits.yaw_acceleration_radps2)
        return ScriptedDriver(course, world, late_s + 0.5 * braking_s)

    def finished(self, course: Scenario, records: Mapping[str, Record]) -> Callable[[], bool]:
        """Whether it has slowed to a stand where the path ends, or since the operator let go."""
        twist, request = records[topics.BODY_COMMAND], records[topics.OPERATOR]
        assert isinstance(twist, TwistCommand)
        assert isinstance(request, OperatorRequest)

        def done() -> bool:
            if course.velocity is None:
                over = bool(twist.arrived)
            else:
                over = request.steering == Steering.VELOCITY and not request.velocity.any()
            return over and not twist.velocity.any() and twist.yaw_rate == 0.0

        return done

    def ready(self, records: Mapping[str, Record]) -> Callable[[], bool]:
        """It can go whenever it stands."""
        return lambda: True

    def broken(self, records: Mapping[str, Record]) -> Sequence[str]:
        """Wheels whose steering is stuck."""
        stuck: list[bool] = records[topics.WHEEL_STATUS].stuck.tolist()  # type: ignore[attr-defined]
        return [f"{name.replace('_', ' ')} wheel stuck" for name, is_so in zip(WHEELS, stuck, strict=True) if is_so]

    def push_ns(self, push: Push, records: Mapping[str, Record], after_ns: int) -> int | None:
        """At once."""
        return after_ns

    def stall_bounds(self) -> Sequence[StallBound]:
        """Those of its kind, by the configuration."""
        return vehicle_bounds(self._config)


SIMULATION = VehicleSimulation
"""Under the name by which every robot's is found."""
