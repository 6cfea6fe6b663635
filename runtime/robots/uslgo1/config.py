# SPDX-License-Identifier: Apache-2.0
"""The configuration of USLGO1: one Struct per section of `uslgo1.toml`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from drivers.bus_load import check_bus_load, worst_bus_load
from drivers.dialects import Ranges, dialect_named
from drivers.errors import DriverConfigError
from drivers.joint_group import JointGroup
from drivers.joints import Joint
from runtime.errors import ConfigError
from runtime.estimation.kalman_config import KalmanConfig
from runtime.legged.footholds import FootholdConfig
from runtime.legged.gait import GaitConfig
from runtime.legged.jacobian_transpose import JacobianTransposeConfig
from runtime.legged.motion_tasks import WholeBodyConfig
from runtime.legged.mpc import MpcConfig
from runtime.legged.posture import PostureConfig
from runtime.legged.swing import SwingConfig
from runtime.models.inertial import InertialConfig
from runtime.models.quadruped import JOINT_NAMES, Quadruped
from runtime.robots.robot_config import BusConfig, RobotConfig, Variant
from runtime.robots.simulation import ScenarioConfig, SimulationConfig
from runtime.safety.config import SafetyConfig
from runtime.safety.limits import joint_bounds
from runtime.tracking.tracker_config import TrackerConfig

NS_PER_SECOND = 1_000_000_000
Pair = tuple[float, float]
Budget = Annotated[int, msgspec.Meta(ge=0, le=NS_PER_SECOND)]


class VariantConfig(Variant, frozen=True, forbid_unknown_fields=True):
    """Which algorithms run.

    Attributes:
        controller: FpMW (fuzzy pursuit, MPC, WBC), FpM (no WBC), pMW (fixed look-ahead).
        estimator: kalman, or truth (simulation only).
        solver: of every quadratic program, daqp or proxqp.
    """

    controller: Literal["FpMW", "FpM", "pMW"] = "FpMW"
    estimator: Literal["kalman", "truth"] = "kalman"
    solver: Literal["daqp", "proxqp"] = "daqp"


class LoopsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Rates, budgets and priorities.

    Attributes:
        wbc_hz, mpc_hz, tracker_hz: rates; each divides the one before.
        wbc_budget_ns, mpc_budget_ns: age at which results leave their loop.
        wbc_priority, mpc_priority: of the threads.
    """

    wbc_hz: Annotated[int, msgspec.Meta(ge=100, le=1000)] = 500
    mpc_hz: Annotated[int, msgspec.Meta(ge=10, le=200)] = 50
    tracker_hz: Annotated[int, msgspec.Meta(ge=5, le=200)] = 25
    wbc_budget_ns: Budget = 800_000
    mpc_budget_ns: Budget = 10_000_000
    wbc_priority: Annotated[int, msgspec.Meta(ge=1, le=98)] = 80
    mpc_priority: Annotated[int, msgspec.Meta(ge=1, le=98)] = 60

    def check(self) -> None:
        """Cross-checks of rates and budgets."""
        for name, rate, base in (("mpc_hz", self.mpc_hz, self.wbc_hz), ("tracker_hz", self.tracker_hz, self.mpc_hz)):
            if base % rate:
                raise ConfigError(f"{name} = {rate} does not divide {base}")
        if NS_PER_SECOND % self.wbc_hz:
            raise ConfigError(f"wbc_hz = {self.wbc_hz} gives a period that is no whole number of nanoseconds")
        for name, budget, rate in (
            ("wbc_budget_ns", self.wbc_budget_ns, self.wbc_hz),
            ("mpc_budget_ns", self.mpc_budget_ns, self.mpc_hz),
        ):
            if budget * rate > NS_PER_SECOND:
                raise ConfigError(f"{name} = {budget} is above the loop's period of {NS_PER_SECOND // rate}")

    @property
    def wbc_period_ns(self) -> int:
        """Period of the fast loop."""
        return NS_PER_SECOND // self.wbc_hz

    @property
    def mpc_period_ns(self) -> int:
        """Period of the slow loop."""
        return NS_PER_SECOND // self.mpc_hz


class DrivesConfig(BusConfig, frozen=True, forbid_unknown_fields=True):
    """The motor drives and their buses; one list entry per joint, legs LF RF LH RH, joints ab/ad hip knee.

    Attributes:
        dialect: of the MIT-mode protocol.
        bus, can_id, direction: of each joint.
        offset_rad: angle of each joint at which its drive reads zero.
        gear_ratio: turns of the drive per turn of the joint.
        position_range_rad, velocity_range_radps, effort_range_nm, stiffness_range_nm_prad, damping_range_nms_prad: what
            the ends of the protocol's fields mean.
        fallback_damping_nms_prad: damping that replaces a command that has become too old.
    """

    dialect: str
    bus: tuple[int, ...]
    can_id: tuple[int, ...]
    master_id: tuple[int, ...]
    direction: tuple[int, ...]
    offset_rad: tuple[float, ...]
    gear_ratio: Annotated[float, msgspec.Meta(gt=0.0, le=200.0)]
    position_range_rad: Pair
    velocity_range_radps: Pair
    effort_range_nm: Pair
    stiffness_range_nm_prad: Pair
    damping_range_nms_prad: Pair
    fallback_damping_nms_prad: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)]

    def check(self) -> None:
        """Every list has one entry per joint."""
        for name in ("bus", "can_id", "master_id", "direction", "offset_rad"):
            length = len(getattr(self, name))
            if length != len(JOINT_NAMES):
                raise ConfigError(f"{name} has {length} entries for {len(JOINT_NAMES)} joints")
        if len(self.channels) != self.buses or len(set(self.channels)) != self.buses:
            raise ConfigError(f"channels = {list(self.channels)} does not name {self.buses} different buses")

    @property
    def buses(self) -> int:
        """Number of buses."""
        return max(self.bus) + 1

    def joints(self, safety: SafetyConfig) -> list[Joint]:
        """The joints as the drivers see them, limited as the safety filter limits them."""
        ranges = Ranges(
            self.position_range_rad,
            self.velocity_range_radps,
            self.effort_range_nm,
            self.stiffness_range_nm_prad,
            self.damping_range_nms_prad,
        )
        low, high = joint_bounds(safety)
        return [
            Joint(
                name,
                self.bus[i],
                self.can_id[i],
                self.master_id[i],
                ranges,
                direction=self.direction[i],
                gear_ratio=self.gear_ratio,
                offset=self.offset_rad[i],
                position_limits=(float(low[i]), float(high[i])),
                effort_limit=safety.effort_max_nm,
                fallback_damping=self.fallback_damping_nms_prad,
            )
            for i, name in enumerate(JOINT_NAMES)
        ]


class Uslgo1Config(RobotConfig, frozen=True, forbid_unknown_fields=True):
    """All of USLGO1."""

    robot: Literal["uslgo1"]
    variant: VariantConfig
    drives: DrivesConfig
    loops: LoopsConfig
    quadruped: Quadruped
    posture: PostureConfig
    gait: GaitConfig
    swing: SwingConfig
    foothold: FootholdConfig
    mpc: MpcConfig
    whole_body: WholeBodyConfig
    jacobian_transpose: JacobianTransposeConfig
    tracker: TrackerConfig
    inertial: InertialConfig
    kalman: KalmanConfig
    safety: SafetyConfig
    simulation: SimulationConfig
    scenario: ScenarioConfig

    @property
    def highest_priority(self) -> int:
        """That of the fast loop."""
        return max(self.loops.wbc_priority, self.loops.mpc_priority)

    def bus_loads(self) -> list[float]:
        """Share of each bus that its drives take at the worst, 0 to 1."""
        drives, dialect = self.drives, dialect_named(self.drives.dialect)
        return [
            worst_bus_load(dialect, drives.bus.count(bus), self.loops.wbc_hz, drives.bit_rate_hz)
            for bus in range(drives.buses)
        ]

    def check(self) -> None:
        """Cross-checks between sections.

        Raises:
            ConfigError: naming the key, the value and the bound.
        """
        try:
            dialect = dialect_named(self.drives.dialect)
            JointGroup(self.drives.joints(self.safety), dialect, self.drives.command_age_max_ns)
        except DriverConfigError as error:
            raise ConfigError(f"drives: {error}") from None
        for bus in range(self.drives.buses):
            try:
                count = self.drives.bus.count(bus)
                check_bus_load(dialect, count, self.loops.wbc_hz, self.drives.bit_rate_hz, bus=f"bus {bus}")
            except DriverConfigError as error:
                raise ConfigError(f"loops.wbc_hz = {self.loops.wbc_hz}: {error}") from None
        if self.mpc.force_min_n > self.mpc.force_max_n:
            raise ConfigError(
                f"mpc.force_min_n = {self.mpc.force_min_n:g} is above mpc.force_max_n = {self.mpc.force_max_n:g}"
            )
        step_ns = self.simulation.time_step_ns
        if self.loops.wbc_period_ns % step_ns:
            raise ConfigError(
                f"simulation.time_step_ns = {step_ns} does not divide the fast loop's period of "
                f"{self.loops.wbc_period_ns}"
            )
        for key in ("imu_rate_hz", "localization_rate_hz"):
            rate = getattr(self.simulation, key)
            if NS_PER_SECOND % (rate * step_ns):
                raise ConfigError(
                    f"simulation.{key} = {rate} gives a period that is no multiple of time_step_ns = {step_ns}"
                )
        for key in ("height_m", "sitting_height_m", "crouching_height_m"):
            height = getattr(self.posture, key)
            try:
                self.quadruped.standing_angles(height)
            except ValueError as error:
                raise ConfigError(f"posture.{key} = {height}: {error}") from None
        if self.tracker.course_lag_s != self.kalman.course_time_s:
            raise ConfigError(
                f"tracker.course_lag_s = {self.tracker.course_lag_s} differs from "
                f"kalman.course_time_s = {self.kalman.course_time_s}"
            )
        grid = self.mpc.steps * self.gait.stance_fraction
        if abs(grid - round(grid)) > 1e-9:
            raise ConfigError(
                f"gait.stance_fraction = {self.gait.stance_fraction} is no multiple of "
                f"1 / mpc.steps = 1 / {self.mpc.steps}"
            )
        if self.gait.period_ns % self.mpc.steps:
            raise ConfigError(f"gait.period_ns = {self.gait.period_ns} is no multiple of mpc.steps = {self.mpc.steps}")


CONFIG = Uslgo1Config
"""Under the name by which every robot's is found."""
