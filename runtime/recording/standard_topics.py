# SPDX-License-Identifier: Apache-2.0
"""The standard ROS topics, derived from the signals off the control loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from runtime import signals, vehicle_signals
from runtime.messages import definitions
from runtime.messages.imu import ImuMessage
from runtime.messages.joint_state import JointStateMessage
from runtime.messages.odometry import OdometryMessage
from runtime.messages.path import PathMessage
from runtime.messages.transform import TransformMessage
from runtime.messages.twist import TwistStampedMessage
from runtime.recording.layout import ChannelSpec
from runtime.records import Record

JOINT_STATE_PERIOD_NS = 10_000_000
"""/joint_states is for viewers; every sample is in the robot's own joint signal."""
ODOMETRY_PERIOD_NS = 20_000_000
_OF_JOINTS = {"JointState": "joint", "WheelState": "axle_drive"}
"""Records that tell of all joints, and the size that counts them."""


@dataclass
class StandardTopic:
    """One standard topic.

    Attributes:
        source: number of the channel it is derived from.
        topic: its name.
        type_name: its ROS type.
        period_ns: least time between two messages; 0 for every sample.
        record: takes up each sample.
        encode: makes the message.
        due_ns: time before which no further message is made.
        last: the sample that the last message was made of; a key-frame may log it again.
    """

    source: int
    topic: str
    type_name: str
    period_ns: int
    record: Record
    encode: Callable[[Any], bytes]
    due_ns: int = 0
    last: bytes = b""

    def message(self, body: memoryview, now_ns: int) -> bytes | None:
        """The message of a sample, or None if it is not yet time for one, or this one was sent."""
        if now_ns < self.due_ns or body == self.last:
            return None
        self.last = bytes(body)
        if self.period_ns:
            self.due_ns = (now_ns // self.period_ns + 1) * self.period_ns
        self.record.load(body)
        return self.encode(self.record)


def standard_topics(channels: Sequence[ChannelSpec], joint_names: Sequence[str]) -> list[StandardTopic]:
    """The standard topics that the channels can fill: the first channel of each kind is the source."""
    makers: dict[str, list[tuple[str, str, int, Callable[[], Callable[[Any], bytes]]]]] = {
        "Imu": [("/imu/data", definitions.IMU, 0, lambda: ImuMessage().encode)],
        "JointState": [
            (
                "/joint_states",
                definitions.JOINT_STATE,
                JOINT_STATE_PERIOD_NS,
                lambda: JointStateMessage(joint_names).encode,
            )
        ],
        "WheelState": [
            (
                "/joint_states",
                definitions.JOINT_STATE,
                JOINT_STATE_PERIOD_NS,
                lambda: JointStateMessage(joint_names).of_wheels,
            )
        ],
        "BodyState": [
            ("/odom", definitions.ODOMETRY, ODOMETRY_PERIOD_NS, lambda: OdometryMessage().encode),
            ("/tf", definitions.TF, ODOMETRY_PERIOD_NS, lambda: TransformMessage().encode),
        ],
        "Path": [("/path", definitions.PATH, 0, lambda: PathMessage().encode)],
        "BodyCommand": [("/cmd_vel", definitions.TWIST_STAMPED, 0, lambda: TwistStampedMessage().encode)],
    }
    makers["VehicleState"], makers["TwistCommand"] = makers["BodyState"], makers["BodyCommand"]
    topics = []
    for spec in channels:
        own: type[Record] | None = getattr(signals, spec.record, None) or getattr(vehicle_signals, spec.record, None)
        if own is None or spec.record not in makers or own("", spec.sizes).ros_definition() != spec.definition:
            continue
        if spec.record in _OF_JOINTS and len(joint_names) != spec.sizes.get(_OF_JOINTS[spec.record]):
            continue
        for topic, type_name, period_ns, make in makers.pop(spec.record):
            record = own(spec.topic, spec.sizes)
            topics.append(StandardTopic(spec.number, topic, type_name, period_ns, record, make()))
    return topics
