# SPDX-License-Identifier: Apache-2.0
"""What the process between zenoh and the loops is told."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from runtime.errors import ConfigError

Age = Annotated[int, msgspec.Meta(gt=0, le=3_600_000_000_000)]
Rate = Annotated[int, msgspec.Meta(gt=0, le=10_000)]
Priority = Annotated[int, msgspec.Meta(ge=0, le=255)]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=255)]
Frames = tuple[Annotated[str, msgspec.Meta(max_length=255)], ...]


class LinkConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where zenoh is met, what is taken from it, and what it is given.

    Attributes:
        domain_id: number of the ROS domain.
        listen, connect: zenoh endpoints.
        zenoh_config: a configuration file of zenoh's own that stands in place of both, or empty.
        type_hashes: rihs01 (Jazzy and later) or humble.
        localization_type: of the messages on /localization/pose.
        odom_frame, base_frame, imu_frame: names of the frames in messages that are sent.
        imu_frames, localization_frames, path_frames, velocity_frames: accepted in received messages; empty for any.
        operator_priority, cmd_vel_priority, teleop_priority: of what comes on /operator/*, /cmd_vel, /teleop/cmd_vel.
        path_speed_mps: along a path while nothing came on /path/speed.
        path_speed_max_mps: a higher one is rejected.
        imu_age_max_ns, localization_age_max_ns, battery_age_max_ns, velocity_age_max_ns, path_age_max_ns: an older
            message is rejected when it arrives, and a path when it is taken up, too.
        request_late_max_ns: what an operator asks for is rejected if it was longer on its way than other messages of
            its publisher by more than this; what stops, disarms or releases is not.
        future_max_ns: a message that is stamped further ahead is rejected; one that is less ahead counts as of now.
        imu_rate_max_hz, localization_rate_max_hz, scan_rate_max_hz, battery_rate_max_hz, path_rate_max_hz,
            operator_rate_max_hz: more messages of a topic are rejected unread, a tenth of a second's worth at once
            excepted; e-stops are always read.
        rate_hz: of the link's own loop.
        joint_states_hz, odometry_hz, state_hz, battery_hz, diagnostics_hz: at most, of what is sent.
        silent_ns: without a tick for so long, control is called silent.
    """

    domain_id: Annotated[int, msgspec.Meta(ge=0, le=232)] = 0
    listen: tuple[Name, ...] = ("tcp/127.0.0.1:7447",)
    connect: tuple[Name, ...] = ()
    zenoh_config: Annotated[str, msgspec.Meta(max_length=4096)] = ""
    type_hashes: Literal["rihs01", "humble"] = "rihs01"
    localization_type: Literal["PoseStamped", "PoseWithCovarianceStamped"] = "PoseStamped"
    odom_frame: Name = "odom"
    base_frame: Name = "base_link"
    imu_frame: Name = "imu_link"
    imu_frames: Frames = ("imu_link", "base_link")
    localization_frames: Frames = ("odom",)
    path_frames: Frames = ("odom",)
    velocity_frames: Frames = ("", "base_link")
    operator_priority: Priority = 20
    cmd_vel_priority: Priority = 10
    teleop_priority: Priority = 30
    path_speed_mps: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 0.5
    path_speed_max_mps: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 2.0
    imu_age_max_ns: Age = 100_000_000
    localization_age_max_ns: Age = 1_000_000_000
    battery_age_max_ns: Age = 5_000_000_000
    velocity_age_max_ns: Age = 500_000_000
    path_age_max_ns: Age = 60_000_000_000
    request_late_max_ns: Age = 500_000_000
    future_max_ns: Age = 20_000_000
    imu_rate_max_hz: Rate = 2000
    localization_rate_max_hz: Rate = 200
    scan_rate_max_hz: Rate = 100
    battery_rate_max_hz: Rate = 50
    path_rate_max_hz: Rate = 10
    operator_rate_max_hz: Rate = 500
    rate_hz: Annotated[int, msgspec.Meta(ge=10, le=1000)] = 100
    joint_states_hz: Rate = 100
    odometry_hz: Rate = 50
    state_hz: Rate = 10
    battery_hz: Rate = 1
    diagnostics_hz: Rate = 1
    silent_ns: Age = 500_000_000

    def check(self) -> None:
        """The default speed keeps its own bound, and the link's period is a whole number."""
        if self.path_speed_mps > self.path_speed_max_mps:
            raise ConfigError(
                f"path_speed_mps = {self.path_speed_mps:g} is above path_speed_max_mps = {self.path_speed_max_mps:g}"
            )
        if 1_000_000_000 % self.rate_hz:
            raise ConfigError(f"rate_hz = {self.rate_hz} gives a period that is no whole number of nanoseconds")
