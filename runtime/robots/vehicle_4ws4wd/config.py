# SPDX-License-Identifier: Apache-2.0
"""The configuration of the 4WS4WD vehicle: one Struct per section of `4ws4wd.toml`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from drivers.errors import DriverConfigError
from drivers.vcu import VehicleUnit
from drivers.vcu_database import OWN_DBC
from runtime.errors import ConfigError
from runtime.estimation.vehicle_filter_config import VehicleFilterConfig
from runtime.models.inertial import InertialConfig
from runtime.models.vehicle import Vehicle
from runtime.robots.robot_config import BusConfig, RobotConfig, Variant
from runtime.robots.vehicle_simulation import VehicleSimulationConfig
from runtime.safety.vehicle_config import VehicleSafetyConfig
from runtime.tracking.delay_estimation import DelayConfig
from runtime.tracking.drive_tracker_config import DriveTrackerConfig
from runtime.tracking.path_speed import SpeedPolicy
from runtime.tracking.prediction import CAPACITY
from runtime.tracking.regulated_pursuit import RegulatedPursuit, RegulatedSpeed
from runtime.tracking.steered_return import SteeredReturn
from runtime.tracking.vehicle_answer import VehicleAnswer
from runtime.tracking.vehicle_tracker import SteeringPolicy
from runtime.tracking.waypoint_pursuit import WaypointPursuit
from runtime.wheeled.steering_sequence import SteeringLimits
from runtime.wheeled.tracking_mpc import TrackingMpcConfig

NS_PER_SECOND = 1_000_000_000
PEERS = ("pure-pursuit", "regulated")
"""Controllers of others, for comparison."""


class VariantConfig(Variant, frozen=True, forbid_unknown_fields=True):
    """Which algorithms run.

    Attributes:
        controller: of paper 002: fuzzy-ldc (look-ahead of Table I and longitudinal distance constraint), either alone,
            or pure-pursuit (neither); regulated pure pursuit; steered-return (as fast as the steering can follow); mpc.
        estimator: kalman, or truth (simulation only).
    """

    controller: Literal["fuzzy-ldc", "fuzzy", "ldc", "pure-pursuit", "regulated", "steered-return", "mpc"] = "fuzzy-ldc"
    estimator: Literal["kalman", "truth"] = "kalman"


class LoopsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The one loop, *drive*.

    Attributes:
        drive_hz, tracker_hz: rates; the second divides the first.
        drive_budget_ns: age at which results leave the loop.
        drive_priority: of the thread.
    """

    drive_hz: Annotated[int, msgspec.Meta(ge=50, le=500)] = 100
    tracker_hz: Annotated[int, msgspec.Meta(ge=5, le=200)] = 50
    drive_budget_ns: Annotated[int, msgspec.Meta(ge=0, le=NS_PER_SECOND)] = 3_000_000
    drive_priority: Annotated[int, msgspec.Meta(ge=1, le=98)] = 80

    def check(self) -> None:
        """Cross-checks of rates and budget."""
        if self.drive_hz % self.tracker_hz:
            raise ConfigError(f"tracker_hz = {self.tracker_hz} does not divide {self.drive_hz}")
        if NS_PER_SECOND % self.drive_hz:
            raise ConfigError(f"drive_hz = {self.drive_hz} gives a period that is no whole number of nanoseconds")
        if self.drive_budget_ns > self.drive_period_ns:
            raise ConfigError(
                f"drive_budget_ns = {self.drive_budget_ns} is above the loop's period of {self.drive_period_ns}"
            )

    @property
    def drive_period_ns(self) -> int:
        """Period of the loop."""
        return NS_PER_SECOND // self.drive_hz

    @property
    def tracker_period_ns(self) -> int:
        """Period of the tracker."""
        return NS_PER_SECOND // self.tracker_hz


class UnitConfig(BusConfig, frozen=True, forbid_unknown_fields=True):
    """The control unit of the vehicle, and its one bus.

    Attributes:
        dbc: file that describes the unit's frames; empty for the one that comes with the drivers.
    """

    dbc: Annotated[str, msgspec.Meta(max_length=4096)] = ""

    def check(self) -> None:
        """There is one bus."""
        if self.buses != 1:
            raise ConfigError(f"channels = {list(self.channels)} does not name one bus")

    def unit(self) -> VehicleUnit:
        """The unit as the drivers see it."""
        return VehicleUnit(self.command_age_max_ns, Path(self.dbc) if self.dbc else OWN_DBC)


class ControllersConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What each controller pursues.

    Attributes:
        fuzzy_ldc, fuzzy, ldc, pure_pursuit, regulated, steered_return, mpc: of the controller of that name.
        regulated_speed: how fast the regulated one drives.
    """

    fuzzy_ldc: WaypointPursuit
    fuzzy: WaypointPursuit
    ldc: WaypointPursuit
    pure_pursuit: WaypointPursuit
    regulated: RegulatedPursuit
    regulated_speed: RegulatedSpeed
    steered_return: SteeredReturn
    mpc: TrackingMpcConfig


class ScenarioConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Changes to a scenario; without them it is as its definition says.

    Attributes:
        speed_mps: commanded speed; 0 keeps the scenario's own.
    """

    speed_mps: Annotated[float, msgspec.Meta(ge=0.0, le=3.0)] = 0.0


class Vehicle4ws4wdConfig(RobotConfig, frozen=True, forbid_unknown_fields=True):
    """All of the vehicle."""

    robot: Literal["4ws4wd"]
    variant: VariantConfig
    drives: UnitConfig
    loops: LoopsConfig
    vehicle: Vehicle
    steering: SteeringLimits
    delay: DelayConfig
    tracker: DriveTrackerConfig
    controllers: ControllersConfig
    inertial: InertialConfig
    kalman: VehicleFilterConfig
    safety: VehicleSafetyConfig
    simulation: VehicleSimulationConfig
    scenario: ScenarioConfig

    @property
    def highest_priority(self) -> int:
        """That of the loop."""
        return self.loops.drive_priority

    @property
    def policy(self) -> SteeringPolicy:
        """The controller that was chosen, if it needs no memory."""
        chosen: SteeringPolicy = getattr(self.controllers, self.variant.controller.replace("-", "_"))
        return chosen

    @property
    def reckons_with_delay(self) -> bool:
        """Whether the controller steers from where the vehicle will be; the peers do not, as published."""
        return self.variant.controller not in PEERS

    @property
    def speed_policy(self) -> SpeedPolicy | None:
        """How fast it drives, where it has a way of its own."""
        return self.controllers.regulated_speed if self.variant.controller == "regulated" else None

    def bus_loads(self) -> list[float]:
        """Share of the bus that commands and states take at the worst, 0 to 1."""
        return [self.drives.unit().check_bus_load(self.loops.drive_hz, self.drives.bit_rate_hz, bound=math.inf)]

    def check(self) -> None:
        """Cross-checks between sections.

        Raises:
            ConfigError: naming the key, the value and the bound.
        """
        try:
            unit = self.drives.unit()
        except DriverConfigError as error:
            raise ConfigError(f"drives.dbc: {error}") from None
        try:
            unit.check_bus_load(self.loops.drive_hz, self.drives.bit_rate_hz)
        except DriverConfigError as error:
            raise ConfigError(f"loops.drive_hz = {self.loops.drive_hz}: {error}") from None
        step_ns = self.simulation.time_step_ns
        if self.loops.drive_period_ns % step_ns:
            raise ConfigError(
                f"simulation.time_step_ns = {step_ns} does not divide the loop's period of {self.loops.drive_period_ns}"
            )
        for key in ("imu_rate_hz", "localization_rate_hz"):
            rate = getattr(self.simulation, key)
            if NS_PER_SECOND % (rate * step_ns):
                raise ConfigError(
                    f"simulation.{key} = {rate} gives a period that is no multiple of time_step_ns = {step_ns}"
                )
        longest_s = CAPACITY * self.loops.tracker_period_ns * 1e-9
        if self.delay.maximum_s > longest_s:
            raise ConfigError(f"delay.maximum_s = {self.delay.maximum_s:g} is above {longest_s:g}")
        self._check_patience()
        self._check_answers()

    def _check_patience(self) -> None:
        """Wheels that answer late must not be taken for wheels that do not answer."""
        delay_ns = self.simulation.command_delay_ns
        for key in ("refusal_ns", "steering_stuck_ns"):
            patience_ns = getattr(self.safety, key)
            if delay_ns >= patience_ns:
                raise ConfigError(
                    f"simulation.command_delay_ns = {delay_ns} is not below safety.{key} = {patience_ns}, after which "
                    "a wheel that does not answer is a fault"
                )

    def _check_answers(self) -> None:
        """There is one vehicle, however many models of its answer there are; one may take it for slower than it is."""
        whole = "tracker.following.answer"
        answers: dict[str, VehicleAnswer | TrackingMpcConfig] = {
            whole: self.tracker.following.answer,
            "controllers.steered_return.answer": self.controllers.steered_return.answer,
            "controllers.mpc": self.controllers.mpc,
        }
        rate, lag = answers[whole].rate_radps, answers[whole].lag_s
        for place, answer in answers.items():
            if answer.wheelbase_m != self.vehicle.wheelbase_m:
                raise ConfigError(
                    f"{place}.wheelbase_m = {answer.wheelbase_m:g} differs from "
                    f"vehicle.wheelbase_m = {self.vehicle.wheelbase_m:g}"
                )
            if answer.lag_s != lag:
                raise ConfigError(f"{place}.lag_s = {answer.lag_s:g} differs from {whole}.lag_s = {lag:g}")
            if answer.rate_radps > rate:
                raise ConfigError(f"{place}.rate_radps = {answer.rate_radps:g} is above {whole}.rate_radps = {rate:g}")


CONFIG = Vehicle4ws4wdConfig
"""Under the name by which every robot's is found."""
