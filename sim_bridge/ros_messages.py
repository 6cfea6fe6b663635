# SPDX-License-Identifier: Apache-2.0
"""What sensors and operator say, as ROS messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from runtime.link import topics as ros
from runtime.messages import definitions, standard
from runtime.messages.battery import BatteryMessage
from runtime.messages.imu import ImuMessage
from runtime.messages.path import PathMessage
from runtime.messages.pose import PoseStampedMessage
from runtime.messages.twist import encode_twist
from runtime.records import Record
from runtime.robots.link_config import LinkConfig
from runtime.signals import Battery, Imu, Motion, OperatorEvent, Path, Pose, Request

Message = tuple[str, bytes]
"""Topic and payload."""


class RosMessages:
    """Turns records into messages.

    Args:
        config: of the link that listens.
    """

    def __init__(self, config: LinkConfig) -> None:
        imu, pose, battery = ImuMessage(config.imu_frame), PoseStampedMessage(config.odom_frame), BatteryMessage()
        self._path = PathMessage(config.odom_frame)
        self._encoders: dict[type[Record], Callable[[Any], Sequence[Message]]] = {
            Imu: lambda record: ((ros.IMU, imu.encode(record)),),
            Pose: lambda record: ((ros.LOCALIZATION, pose.encode(record)),),
            Battery: lambda record: ((ros.BATTERY, battery.encode(record)),),
            Path: self._path_messages,
            OperatorEvent: lambda record: (operator_message(record),),
        }

    def of(self, record: Record) -> Sequence[Message]:
        """The messages that say what a record says, which is stamped in unix time."""
        return self._encoders[type(record)](record)

    def _path_messages(self, path: Path) -> Sequence[Message]:
        """The speed, then the path, whose first point closes it again."""
        sent = path.like()
        sent.copy_from(path)
        if path.closed and path.count < len(path.x):
            sent.x[path.count], sent.y[path.count] = path.x[0], path.y[0]
            sent.count, sent.closed = path.count + 1, False
        return (
            (ros.PATH_SPEED, standard.encode_float64(path.speed)),
            (ros.PATH, self._path.encode(sent)),
        )


def operator_message(event: OperatorEvent) -> Message:
    """An operator's event as the message that asks for it."""
    request = Request(event.request)
    if request in (Request.ARM, Request.DISARM):
        return ros.ARM, standard.encode_bool(request == Request.ARM)
    if request == Request.MOTION:
        return ros.MOTION, standard.encode_string(Motion(event.motion).name.lower())
    if request == Request.EMERGENCY_STOP:
        return ros.E_STOP, standard.encode_bool(True)
    if request == Request.VELOCITY:
        return ros.CMD_VEL, encode_twist(*event.velocity.tolist())
    plain = {Request.LIFE: ros.HEARTBEAT, Request.RESET: ros.RESET, Request.RELEASE: ros.RELEASE}
    return plain[request], standard.encode_empty()


TYPES = {
    ros.IMU: definitions.IMU,
    ros.LOCALIZATION: definitions.POSE_STAMPED,
    ros.BATTERY: definitions.BATTERY_STATE,
    ros.PATH: definitions.PATH,
    ros.PATH_SPEED: definitions.FLOAT64,
    ros.CMD_VEL: definitions.TWIST,
    ros.ARM: definitions.BOOL,
    ros.E_STOP: definitions.BOOL,
    ros.MOTION: definitions.STRING,
    ros.HEARTBEAT: definitions.EMPTY,
    ros.RESET: definitions.EMPTY,
    ros.RELEASE: definitions.EMPTY,
}
"""Of the topics by which sensors and operator speak."""
