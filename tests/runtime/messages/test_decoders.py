# SPDX-License-Identifier: Apache-2.0
"""What an independent ROS 2 implementation writes is read as it was meant; any other bytes are refused, and no more."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_typestore

from runtime.messages import definitions
from runtime.messages.battery import decode_battery_state
from runtime.messages.errors import MessageError
from runtime.messages.imu import decode_imu
from runtime.messages.path import decode_path
from runtime.messages.pose import decode_pose_stamped, decode_pose_with_covariance_stamped
from runtime.messages.scan import decode_laser_scan, decode_point_cloud
from runtime.messages.standard import decode_bool, decode_empty, decode_float64, decode_string
from runtime.messages.twist import decode_twist, decode_twist_stamped

STORE = get_typestore(Stores.ROS2_JAZZY)
T = STORE.types
CAPACITY = 5
DECODERS = {
    definitions.IMU: decode_imu,
    definitions.POSE_STAMPED: decode_pose_stamped,
    definitions.POSE_WITH_COVARIANCE_STAMPED: decode_pose_with_covariance_stamped,
    definitions.TWIST: decode_twist,
    definitions.TWIST_STAMPED: decode_twist_stamped,
    definitions.PATH: lambda payload: decode_path(payload, CAPACITY),
    definitions.BATTERY_STATE: decode_battery_state,
    definitions.LASER_SCAN: decode_laser_scan,
    definitions.POINT_CLOUD2: decode_point_cloud,
    definitions.BOOL: decode_bool,
    definitions.STRING: decode_string,
    definitions.EMPTY: decode_empty,
    definitions.FLOAT64: decode_float64,
}
ANY = st.floats(width=64)
ANY32 = st.floats(width=32)
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


def make(name: str, *parts):
    return T[name](*parts)


STAMPS = st.builds(
    lambda s, n: make("builtin_interfaces/msg/Time", s, n), st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1)
)
HEADERS = st.builds(lambda stamp, frame: make("std_msgs/msg/Header", stamp, frame), STAMPS, TEXTS)
XYZ = st.builds(lambda x, y, z: make("geometry_msgs/msg/Vector3", x, y, z), ANY, ANY, ANY)
POINTS = st.builds(lambda x, y, z: make("geometry_msgs/msg/Point", x, y, z), ANY, ANY, ANY)
QUATERNIONS = st.builds(lambda *q: make("geometry_msgs/msg/Quaternion", *q), ANY, ANY, ANY, ANY)
POSES = st.builds(lambda p, q: make("geometry_msgs/msg/Pose", p, q), POINTS, QUATERNIONS)
STAMPED_POSES = st.builds(lambda h, p: make(definitions.POSE_STAMPED, h, p), HEADERS, POSES)
TWISTS = st.builds(lambda a, b: make(definitions.TWIST, a, b), XYZ, XYZ)
NINE = arrays(np.float64, 9, elements=ANY)
THIRTY_SIX = arrays(np.float64, 36, elements=ANY)
FLOATS = arrays(np.float32, st.integers(0, 9), elements=ANY32)
MESSAGES = {
    definitions.IMU: st.builds(
        lambda *parts: make(definitions.IMU, *parts), HEADERS, QUATERNIONS, NINE, XYZ, NINE, XYZ, NINE
    ),
    definitions.POSE_STAMPED: STAMPED_POSES,
    definitions.POSE_WITH_COVARIANCE_STAMPED: st.builds(
        lambda h, p, c: make(
            definitions.POSE_WITH_COVARIANCE_STAMPED, h, make("geometry_msgs/msg/PoseWithCovariance", p, c)
        ),
        HEADERS,
        POSES,
        THIRTY_SIX,
    ),
    definitions.TWIST: TWISTS,
    definitions.TWIST_STAMPED: st.builds(lambda h, t: make(definitions.TWIST_STAMPED, h, t), HEADERS, TWISTS),
    definitions.PATH: st.builds(
        lambda h, p: make(definitions.PATH, h, p), HEADERS, st.lists(STAMPED_POSES, max_size=CAPACITY)
    ),
    definitions.BATTERY_STATE: st.builds(
        lambda *parts: make(definitions.BATTERY_STATE, *parts),
        HEADERS,
        *[ANY32] * 7,
        *[st.integers(0, 255)] * 3,
        st.booleans(),
        FLOATS,
        FLOATS,
        TEXTS,
        TEXTS,
    ),
    definitions.LASER_SCAN: st.builds(
        lambda *parts: make(definitions.LASER_SCAN, *parts), HEADERS, *[ANY32] * 7, FLOATS, FLOATS
    ),
    definitions.BOOL: st.builds(lambda value: make(definitions.BOOL, value), st.booleans()),
    definitions.STRING: st.builds(lambda value: make(definitions.STRING, value), TEXTS),
    definitions.EMPTY: st.builds(lambda: make(definitions.EMPTY)),
    definitions.FLOAT64: st.builds(lambda value: make(definitions.FLOAT64, value), ANY),
}


def payload_of(message, name: str, little: bool = True) -> bytes:
    return bytes(STORE.serialize_cdr(message, name, little_endian=little))


def stamp_of(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def same(read, written) -> bool:
    return np.array_equal(np.array(read, float), np.array(written, float), equal_nan=True)


def xyz(vector) -> list[float]:
    return [vector.x, vector.y, vector.z]


def expected(message, name: str):
    """What should be read, as (stamp, frame, numbers)."""
    if name == definitions.IMU:
        return (
            stamp_of(message),
            message.header.frame_id,
            xyz(message.angular_velocity) + xyz(message.linear_acceleration),
        )
    if name in (definitions.POSE_STAMPED, definitions.POSE_WITH_COVARIANCE_STAMPED):
        pose = message.pose if name == definitions.POSE_STAMPED else message.pose.pose
        return (
            stamp_of(message),
            message.header.frame_id,
            [*xyz(pose.position), *xyz(pose.orientation), pose.orientation.w],
        )
    if name in (definitions.TWIST, definitions.TWIST_STAMPED):
        twist = message if name == definitions.TWIST else message.twist
        where = (0, "") if name == definitions.TWIST else (stamp_of(message), message.header.frame_id)
        return *where, [twist.linear.x, twist.linear.y, twist.angular.z]
    if name == definitions.PATH:
        points = [value for pose in message.poses for value in (pose.pose.position.x, pose.pose.position.y)]
        return stamp_of(message), message.header.frame_id, points
    if name == definitions.BATTERY_STATE:
        return stamp_of(message), "", [message.voltage, -message.current, message.percentage]
    if name == definitions.LASER_SCAN:
        numbers = [message.angle_min, message.angle_increment, message.range_min, message.range_max, *message.ranges]
        return stamp_of(message), message.header.frame_id, numbers
    return 0, "", [getattr(message, "data", None)]


def found(value, name: str):
    if name in (definitions.BOOL, definitions.STRING, definitions.EMPTY, definitions.FLOAT64):
        return 0, "", [value]
    if name == definitions.BATTERY_STATE:
        return value.stamp_ns, "", list(value[1:])
    numbers = [np.ravel(part) for part in value[2:]]
    return value.stamp_ns, value.frame, np.concatenate(numbers).tolist()


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=60, deadline=None)
@given(data=st.data(), little=st.booleans())
def test_what_others_write_is_read(name, data, little):
    message = data.draw(MESSAGES[name])
    payload = payload_of(message, name, little)
    want, got = expected(message, name), found(DECODERS[name](payload), name)
    assert got[:2] == want[:2]
    assert got[2] == want[2] if name in (definitions.STRING, definitions.EMPTY) else same(got[2], want[2])
    DECODERS[name](payload + bytes(3))


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=40, deadline=None)
@given(data=st.data(), little=st.booleans())
def test_a_message_cut_short_or_drawn_out_is_refused(name, data, little):
    payload = payload_of(data.draw(MESSAGES[name]), name, little)
    with pytest.raises(MessageError):
        DECODERS[name](payload + bytes(data.draw(st.integers(5, 40))))
    # an Empty has nothing that could be missing but its header
    cut = data.draw(st.integers(0, len(payload) - 1 if name != definitions.EMPTY else 3))
    with pytest.raises(MessageError):
        DECODERS[name](payload[:cut])


HEADER = st.sampled_from([b"\0\1\0\0", b"\0\0\0\0"])
ORDERS = st.sampled_from(["little", "big"])
SMALL = st.builds(lambda number, order: number.to_bytes(4, order), st.integers(0, 9), ORDERS)
PARTS = st.lists(SMALL | st.binary(max_size=12), max_size=40)
SOUP = st.binary(max_size=300) | st.builds(lambda head, parts: head + b"".join(parts), HEADER, PARTS)


@pytest.mark.parametrize("name", DECODERS)
@settings(max_examples=300, deadline=None)
@given(payload=SOUP)
def test_any_bytes_give_a_value_or_the_one_error(name, payload):
    try:
        DECODERS[name](payload)
    except MessageError as error:
        assert str(error)


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_damaged_message_gives_a_value_or_the_one_error(name, data):
    payload = bytearray(payload_of(data.draw(MESSAGES[name]), name))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        DECODERS[name](bytes(payload))
    except MessageError as error:
        assert str(error)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "too early"),
        (b"\0\3\0\0\1", "plain CDR"),
        (b"\1\1\0\0\1", "plain CDR"),
        (b"\0\1\0\0\2", "neither true nor false"),
    ],
)
def test_what_is_wrong_is_said(payload, reason):
    with pytest.raises(MessageError, match=reason):
        decode_bool(payload)


def test_a_path_beyond_the_capacity_is_not_even_looked_at():
    payload = bytearray(b"\0\1\0\0" + bytes(8) + b"\1\0\0\0\0\0\0\0" + (2**32 - 1).to_bytes(4, "little"))
    with pytest.raises(MessageError, match="too many poses"):
        decode_path(bytes(payload), CAPACITY)


def test_a_sequence_longer_than_the_buffer_is_refused_without_making_room_for_it():
    scan = b"\0\1\0\0" + bytes(8) + b"\1\0\0\0\0\0\0\0" + bytes(28) + (2**32 - 1).to_bytes(4, "little")
    with pytest.raises(MessageError, match="too early"):
        decode_laser_scan(scan)


def cloud(points: np.ndarray, step: int = 16, pad: int = 0, big: bool = False, names: str = "xyz"):
    fields = [make("sensor_msgs/msg/PointField", name, 4 * i, 7, 1) for i, name in enumerate(names)]
    rows, columns = points.shape[:2]
    data = np.zeros((rows, columns * step + pad), np.uint8)
    for row in range(rows):
        for column in range(columns):
            packed = points[row, column].astype(">f4" if big else "<f4").tobytes()
            data[row, column * step : column * step + 12] = np.frombuffer(packed, np.uint8)
    header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 1, 2), "lidar")
    sizes = (step, columns * step + pad)
    return make(definitions.POINT_CLOUD2, header, rows, columns, fields, big, *sizes, data.ravel(), True)


@settings(max_examples=40, deadline=None)
@given(
    arrays(np.float32, st.tuples(st.integers(1, 3), st.integers(1, 4), st.just(3)), elements=ANY32),
    st.integers(12, 20),
    st.integers(0, 5),
    st.booleans(),
)
def test_point_cloud(points, step, pad, big):
    read = decode_point_cloud(payload_of(cloud(points, step, pad, big), definitions.POINT_CLOUD2))
    assert (read.stamp_ns, read.frame) == (1_000_000_002, "lidar")
    assert np.array_equal(read.points, points.reshape(-1, 3), equal_nan=True)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"width": 3}, "sizes"),
        ({"row_step": 1}, "sizes"),
        ({"point_step": 11, "row_step": 32}, "parts"),
        ({"point_step": 2000, "width": 0, "height": 0, "data": np.zeros(0, np.uint8)}, "too large"),
        ({"fields": []}, "no x, y and z"),
    ],
)
def test_a_cloud_whose_sizes_do_not_agree_is_refused(change, reason):
    message = cloud(np.zeros((1, 2, 3), np.float32))
    for name, value in change.items():
        object.__setattr__(message, name, value)
    with pytest.raises(MessageError, match=reason):
        decode_point_cloud(payload_of(message, definitions.POINT_CLOUD2))


def test_what_a_battery_does_not_measure_is_no_number():
    header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 1, 2), "")
    floats, cells = (29.0, *[math.nan] * 5, 0.5), np.zeros(0, np.float32)
    message = make(definitions.BATTERY_STATE, header, *floats, 0, 0, 0, True, cells, cells, "", "")
    report = decode_battery_state(payload_of(message, definitions.BATTERY_STATE))
    assert math.isnan(report.current)
    assert (report.voltage, report.charge) == (29.0, 0.5)
