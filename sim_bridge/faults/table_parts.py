# SPDX-License-Identifier: Apache-2.0
"""What the tables of all robots are made of: what is counted or named, and how soon a fault is known."""

from __future__ import annotations

from runtime.robots import topics
from runtime.robots.uslgo1.config import NS_PER_SECOND, Uslgo1Config
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.signals import Fault
from sim_bridge.script import PERIOD_NS

MS = 1_000_000
AnyConfig = Uslgo1Config | Vehicle4ws4wdConfig

COASTED, SKIPPED = (topics.SAFETY, "coasted"), (topics.TIMING, "skipped")
IMU_REJECTED = (topics.BODY_STATE, "imu_rejected")
POSE_REJECTED = (topics.BODY_STATE, "localization_rejected")
PATH_REJECTED, PATH_FOREIGN = (topics.BODY_COMMAND, "rejected_paths"), (topics.BODY_COMMAND, "foreign_paths")
REFUSED, MALFORMED = (topics.OPERATOR, "refused"), (topics.OPERATOR, "malformed")
LEASES = (topics.OPERATOR, "leases")
SPIKING, BACKWARDS = Fault.STALE_IMU | Fault.IMPLAUSIBLE_IMU, Fault.STALE_IMU | Fault.IMU_TIME


def at_once(config: AnyConfig) -> int:
    """It needs no time."""
    return 0


def imu_stale(config: AnyConfig) -> int:
    """Until the last sample is too old."""
    return config.safety.imu_age_max_ns


def pose_missing(config: AnyConfig) -> int:
    """Until the last pose is too old."""
    return config.safety.localization_age_max_ns


def pose_disputed(config: AnyConfig) -> int:
    """Until enough poses agree that it is elsewhere."""
    period_ns = NS_PER_SECOND // config.simulation.localization_rate_hz
    return (config.safety.disputed_poses_max + 1) * period_ns + config.simulation.localization_latency_ns


def lease_over(config: AnyConfig) -> int:
    """Until the lease of a silent operator is over."""
    return config.authority.lease_ns + PERIOD_NS


def velocity_old(config: AnyConfig) -> int:
    """Until the velocity that was asked for is too old."""
    return config.tracker.velocity.age_max_ns
