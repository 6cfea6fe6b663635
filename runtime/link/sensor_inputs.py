# SPDX-License-Identifier: Apache-2.0
"""Measurements from zenoh to the control loops: inertial samples, localisation and battery; scans are only watched."""

from __future__ import annotations

from collections.abc import Callable

from runtime.link.checks import check_finite, check_frame, unit_quaternion
from runtime.link.clocks import Instant, StampWindow
from runtime.messages.battery import BatteryReport
from runtime.messages.imu import InertialSample
from runtime.messages.pose import StampedPose
from runtime.messages.scan import Cloud, Scan
from runtime.robots.link_config import LinkConfig
from runtime.signals import Battery, Imu, Pose


class ImuUse:
    """Fills and hands on `Imu` records; the sensor's axes are those of the base.

    Args:
        config: frames and ages.
        record: to fill.
        write: hands it on.
    """

    def __init__(self, config: LinkConfig, record: Imu, write: Callable[[Imu], None]) -> None:
        self._frames, self._record, self._write = config.imu_frames, record, write
        self._window = StampWindow(config.imu_age_max_ns, config.future_max_ns)

    def __call__(self, sample: InertialSample, source: int, now: Instant) -> None:
        """Use a sample."""
        check_frame(sample.frame, self._frames)
        check_finite(*sample.angular_velocity, *sample.linear_acceleration)
        record = self._record
        record.stamp_ns = self._window.monotonic_ns(sample.stamp_ns, now)
        record.sequence += 1
        record.angular_velocity[:] = sample.angular_velocity
        record.linear_acceleration[:] = sample.linear_acceleration
        self._write(record)


class PoseUse:
    """Fills and hands on `Pose` records; arguments as of `ImuUse`."""

    def __init__(self, config: LinkConfig, record: Pose, write: Callable[[Pose], None]) -> None:
        self._frames, self._record, self._write = config.localization_frames, record, write
        self._window = StampWindow(config.localization_age_max_ns, config.future_max_ns)

    def __call__(self, pose: StampedPose, source: int, now: Instant) -> None:
        """Use a pose."""
        check_frame(pose.frame, self._frames)
        check_finite(*pose.position, *pose.orientation)
        orientation = unit_quaternion(pose.orientation)
        record = self._record
        record.stamp_ns = self._window.monotonic_ns(pose.stamp_ns, now)
        record.sequence += 1
        record.position[:] = pose.position
        record.orientation[:] = orientation
        self._write(record)


class BatteryUse:
    """Fills and hands on `Battery` records; current and charge may be unknown (NaN). Arguments as of `ImuUse`."""

    def __init__(self, config: LinkConfig, record: Battery, write: Callable[[Battery], None]) -> None:
        self._record, self._write = record, write
        self._window = StampWindow(config.battery_age_max_ns, config.future_max_ns)

    def __call__(self, report: BatteryReport, source: int, now: Instant) -> None:
        """Use a report."""
        check_finite(report.voltage)
        record = self._record
        record.stamp_ns = self._window.monotonic_ns(report.stamp_ns, now)
        record.voltage, record.current, record.charge = report.voltage, report.current, report.charge
        self._write(record)


def watch_scan(scan: Scan | Cloud, source: int, now: Instant) -> None:
    """See that a scan can be read, which is all: no task uses scans yet."""
