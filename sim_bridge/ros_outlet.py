# SPDX-License-Identifier: Apache-2.0
"""The simulated robot's sensor stack and operator as they speak on a real one: ROS messages over zenoh.

Messages are laid out where the world is stepped, and sent by a thread of their own: sending may take milliseconds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from types import TracebackType
from typing import Any

from runtime.link import topics as ros
from runtime.messages import definitions, standard
from runtime.messages.battery import BatteryMessage
from runtime.messages.imu import ImuMessage
from runtime.messages.keys import DEFAULT_QUALITY, SENSOR_QUALITY
from runtime.messages.path import PathMessage
from runtime.messages.pose import PoseStampedMessage
from runtime.messages.session import Publisher, RosSession, session_config
from runtime.messages.twist import encode_twist
from runtime.records import Record
from runtime.robots.link_config import LinkConfig
from runtime.signals import Battery, Imu, Motion, OperatorEvent, Path, Pose, Request

Message = tuple[str, bytes]
"""Topic and payload."""
CLOCK_STEP_NS = 5_000_000


class RosOutlet:
    """A node that publishes what sensors and the operator say.

    Args:
        config: of the link that listens.
        node: its name.

    Raises:
        SessionError: if the link is not there.
    """

    def __init__(self, config: LinkConfig, node: str = "ugv_sim") -> None:
        self._session = RosSession(node, config.domain_id, session_config((), config.listen), config.type_hashes)
        self._publishers = {topic: self._publisher(topic, name) for topic, name in TYPES.items()}
        imu, pose, battery = ImuMessage(config.imu_frame), PoseStampedMessage(config.odom_frame), BatteryMessage()
        self._path = PathMessage(config.odom_frame)
        self._encoders: dict[type[Record], Callable[[Any], Sequence[Message]]] = {
            Imu: lambda record: ((ros.IMU, imu.encode(record)),),
            Pose: lambda record: ((ros.LOCALIZATION, pose.encode(record)),),
            Battery: lambda record: ((ros.BATTERY, battery.encode(record)),),
            Path: self._path_messages,
            OperatorEvent: lambda record: (operator_message(record),),
        }
        self._unix_offset_ns = 0
        self._waiting: SimpleQueue[Message | None] = SimpleQueue()
        self._sender = threading.Thread(target=self._send, name="ros")
        self._sender.start()

    def _publisher(self, topic: str, type_name: str) -> Publisher:
        return self._session.publisher(topic, type_name, SENSOR_QUALITY if topic == ros.IMU else DEFAULT_QUALITY)

    def publish(self, record: Record, start_ns: int) -> None:
        """Send a record, stamped in unix time."""
        record.stamp_ns += start_ns + self._unix_offset()  # type: ignore[attr-defined]
        for message in self._encoders[type(record)](record):
            self._waiting.put(message)

    def _unix_offset(self) -> int:
        """From the monotonic to the unix clock, which may be set at any time; the reading's own noise is left out."""
        offset_ns = time.time_ns() - time.monotonic_ns()
        if abs(offset_ns - self._unix_offset_ns) > CLOCK_STEP_NS:
            self._unix_offset_ns = offset_ns
        return self._unix_offset_ns

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

    def _send(self) -> None:
        while (message := self._waiting.get()) is not None:
            topic, payload = message
            self._publishers[topic].put(payload)

    def close(self) -> None:
        """Send what waits, and leave."""
        self._waiting.put(None)
        self._sender.join()
        self._session.close()

    def __enter__(self) -> RosOutlet:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


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
