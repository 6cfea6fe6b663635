# SPDX-License-Identifier: Apache-2.0
"""What comes over zenoh: messages as CDR, their attachments, and the tokens by which publishers are known."""

from __future__ import annotations

import functools
from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np
from fuzz_target import Target
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from runtime.link.senders import SenderBook
from runtime.messages import attachment, battery, definitions, imu, path, pose, scan, standard, twist
from runtime.messages.keys import Node, publisher_of
from runtime.recording.log import Log

CDR = b"\0\1\0\0"


decode_path = functools.partial(path.decode_path, capacity=100)
"""With the capacity of the robot's path."""


STORE = get_typestore(Stores.ROS2_JAZZY)


def message(type_name: str) -> Callable[[], list[bytes]]:
    """Messages of a type as an independent implementation writes them: with empty lists, and with some of one."""
    return lambda: [bytes(STORE.serialize_cdr(sample(type_name, length), type_name)) for length in (0, 1, 3)]


def sample(type_name: str, length: int) -> Any:
    """A message of plain values."""
    values = {name: _value(node, length) for name, node in STORE.fielddefs[type_name][1]}
    return STORE.types[type_name](**values)


def _value(node: Any, length: int) -> Any:
    kind, content = node
    if kind is Nodetype.BASE:
        return {"string": "odom", "bool": True}.get(content[0], 1)
    if kind is Nodetype.NAME:
        return sample(content, length)
    part, number = content
    count = number if kind is Nodetype.ARRAY else length
    if part[0] is Nodetype.BASE and part[1][0] != "string":
        return np.ones(count, part[1][0])
    return [_value(part, length) for _ in range(count)]


def clouds() -> list[bytes]:
    """Clouds of points with x, y and z, of none and of two."""
    found = []
    for count in (0, 2):
        cloud = sample(definitions.POINT_CLOUD2, 0)
        part = STORE.types["sensor_msgs/msg/PointField"]
        cloud.fields = [part(name, 4 * place, 7, 1) for place, name in enumerate("xyz")]
        cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, count, 12, 12 * count
        cloud.is_bigendian, cloud.data = False, np.ones(12 * count, np.uint8)
        found.append(bytes(STORE.serialize_cdr(cloud, definitions.POINT_CLOUD2)))
    return found


def bodies(topic: str, head: bytes = b"") -> Callable[[Log], list[bytes]]:
    """Some messages of a topic of a recorded run."""
    return lambda log: [head + bytes(message.body) for message in islice(log.messages([topic]), 0, 200, 20)]


@functools.cache
def senders() -> SenderBook:
    """Who publishes, as far as tokens have told."""
    return SenderBook()


def decode_token(data: bytes) -> None:
    """A liveliness token that comes, and goes with every other one."""
    book, token = senders(), data.decode(errors="replace")
    place, before = publisher_of(token), book.overlooked
    book.note(token, True)
    if place is not None:
        assert isinstance(book.source(place[1], data[:16], 1), int)
        assert book.overlooked - before in (0, 1)
    if len(data) % 2:
        book.note(token, False)


def token_seeds() -> list[bytes]:
    """Tokens of a node, a publisher and a subscription."""
    node = Node(0, "0123456789abcdef", "panel")
    ends = [node.endpoint_token(number, kind, "/path", definitions.PATH) for number, kind in enumerate(("MP", "MS"))]
    return [token.encode() for token in (node.token(), *ends)]


MESSAGES = ("runtime.messages",)

TARGETS = (
    Target("token", decode_token, ("runtime.messages.keys", "runtime.link.senders"), token_seeds),
    Target(
        "attachment", attachment.parse_attachment, MESSAGES, lambda: [attachment.Attachment(1, 2, bytes(16)).to_bytes()]
    ),
    Target("imu", imu.decode_imu, MESSAGES, message(definitions.IMU), bodies("/imu/data", CDR)),
    Target("pose", pose.decode_pose_stamped, MESSAGES, message(definitions.POSE_STAMPED)),
    Target(
        "pose_covariance",
        pose.decode_pose_with_covariance_stamped,
        MESSAGES,
        message(definitions.POSE_WITH_COVARIANCE_STAMPED),
    ),
    Target("twist", twist.decode_twist, MESSAGES, message(definitions.TWIST)),
    Target(
        "twist_stamped",
        twist.decode_twist_stamped,
        MESSAGES,
        message(definitions.TWIST_STAMPED),
        bodies("/cmd_vel", CDR),
    ),
    Target("path_message", decode_path, MESSAGES, message(definitions.PATH), bodies("/path", CDR)),
    Target("battery", battery.decode_battery_state, MESSAGES, message(definitions.BATTERY_STATE)),
    Target("scan", scan.decode_laser_scan, MESSAGES, message(definitions.LASER_SCAN)),
    Target("cloud", scan.decode_point_cloud, MESSAGES, clouds),
    Target("empty", standard.decode_empty, MESSAGES, message(definitions.EMPTY)),
    Target("bool", standard.decode_bool, MESSAGES, message(definitions.BOOL)),
    Target("string", standard.decode_string, MESSAGES, message(definitions.STRING)),
    Target("float64", standard.decode_float64, MESSAGES, message(definitions.FLOAT64)),
)
