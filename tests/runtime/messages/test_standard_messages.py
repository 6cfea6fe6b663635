# SPDX-License-Identifier: Apache-2.0
"""The hand-packed messages are what an independent ROS 2 implementation reads."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from runtime.messages import definitions
from runtime.messages.battery import BatteryMessage, decode_battery_state
from runtime.messages.diagnostics import Level, Status, encode_diagnostics
from runtime.messages.imu import ImuMessage
from runtime.messages.joint_state import JointStateMessage
from runtime.messages.odometry import OdometryMessage
from runtime.messages.path import PathMessage, decode_path
from runtime.messages.standard import decode_string, encode_string
from runtime.messages.transform import TransformMessage, encode_fixed
from runtime.messages.twist import TwistStampedMessage
from runtime.signals import Battery, BodyCommand, BodyState, Imu, JointState, Path

STORE = get_typestore(Stores.ROS2_HUMBLE)
STAMPS = st.integers(0, 2**31 * 10**9 - 1)
NUMBERS = st.floats(-1e6, 1e6)
FRAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


def vectors(length: int):
    return arrays(np.float64, length, elements=NUMBERS)


def check_stamp(stamp, stamp_ns: int) -> None:
    assert (stamp.sec, stamp.nanosec) == divmod(stamp_ns, 10**9)


def xyz(vector) -> list[float]:
    return [vector.x, vector.y, vector.z]


def read(payload: bytes, type_name: str):
    message = STORE.deserialize_cdr(payload, type_name)
    assert bytes(STORE.serialize_cdr(message, type_name)) == payload, "the oracle writes the same bytes"
    return message


@pytest.mark.parametrize(
    ("stamp_ns", "second"), [(2**63 - 1, 2**31 - 1), (2**31 * 10**9, 2**31 - 1), (-(2**63), -(2**31))]
)
def test_a_stamp_beyond_those_of_messages_is_the_nearest_of_them(stamp_ns, second):
    imu = Imu("/imu")
    imu.stamp_ns = stamp_ns
    assert read(ImuMessage("imu_link").encode(imu), definitions.IMU).header.stamp.sec == second


@settings(max_examples=50, deadline=None)
@given(STAMPS, FRAMES, vectors(3), vectors(3))
def test_imu(stamp_ns, frame, acceleration, rate):
    imu = Imu("/imu")
    imu.stamp_ns, imu.linear_acceleration, imu.angular_velocity = stamp_ns, acceleration, rate
    message = read(ImuMessage(frame).encode(imu), definitions.IMU)
    check_stamp(message.header.stamp, stamp_ns)
    assert message.header.frame_id == frame
    assert xyz(message.linear_acceleration) == acceleration.tolist()
    assert xyz(message.angular_velocity) == rate.tolist()
    assert message.orientation_covariance[0] == -1
    assert message.orientation.w == 1


@settings(max_examples=50, deadline=None)
@given(STAMPS, st.lists(FRAMES, max_size=14), st.data())
def test_joint_state(stamp_ns, names, data):
    if not names:
        names = ["only"]
    joints = JointState("/joints", {"joint": len(names)})
    joints.stamp_ns = stamp_ns
    for part in ("position", "velocity", "effort"):
        setattr(joints, part, data.draw(vectors(len(names))))
    message = read(JointStateMessage(names).encode(joints), definitions.JOINT_STATE)
    check_stamp(message.header.stamp, stamp_ns)
    assert list(message.name) == names
    for part in ("position", "velocity", "effort"):
        assert np.array_equal(getattr(message, part), getattr(joints, part))


def body_state(stamp_ns, position, orientation, linear, angular) -> BodyState:
    body = BodyState("/body", {"foot": 4, "foot_xyz": 12})
    body.stamp_ns, body.position, body.angular_velocity, body.linear_velocity = stamp_ns, position, angular, linear
    norm = np.linalg.norm(orientation)
    body.orientation = orientation / norm if norm > 1e-3 else (0.0, 0.0, 0.0, 1.0)
    return body


@settings(max_examples=50, deadline=None)
@given(STAMPS, vectors(3), arrays(np.float64, 4, elements=st.floats(-1, 1)), vectors(3), vectors(3))
def test_odometry_and_transform(stamp_ns, position, orientation, linear, angular):
    body = body_state(stamp_ns, position, orientation, linear, angular)
    odometry = read(OdometryMessage().encode(body), definitions.ODOMETRY)
    transform = read(TransformMessage().encode(body), definitions.TF).transforms[0]
    for message in (odometry, transform):
        check_stamp(message.header.stamp, stamp_ns)
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    assert xyz(odometry.pose.pose.position) == xyz(transform.transform.translation) == position.tolist()
    turned = odometry.pose.pose.orientation
    assert [turned.x, turned.y, turned.z, turned.w] == body.orientation.tolist()
    assert transform.transform.rotation == turned
    assert xyz(odometry.twist.twist.angular) == angular.tolist()
    x, y, z, w = body.orientation
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    np.testing.assert_allclose(xyz(odometry.twist.twist.linear), rotation.T @ linear, atol=1e-8)


@settings(max_examples=50, deadline=None)
@given(STAMPS, st.integers(0, 12), st.booleans(), vectors(12), vectors(12))
def test_path(stamp_ns, count, closed, x, y):
    path = Path("/path", {"path": 12})
    path.stamp_ns, path.count, path.closed, path.x, path.y = stamp_ns, count, closed, x, y
    message = read(PathMessage().encode(path), definitions.PATH)
    check_stamp(message.header.stamp, stamp_ns)
    assert [pose.pose.position.x for pose in message.poses] == x[:count].tolist()
    assert [pose.pose.position.y for pose in message.poses] == y[:count].tolist()


def test_poses_of_a_path_look_along_it():
    path = Path("/path", {"path": 3})
    path.count, path.x, path.y = 3, (0, 0, -1), (0, 1, 1)
    poses = STORE.deserialize_cdr(PathMessage().encode(path), definitions.PATH).poses
    headings = [2 * np.arctan2(p.pose.orientation.z, p.pose.orientation.w) for p in poses]
    np.testing.assert_allclose(headings, [np.pi / 2, np.pi, np.pi])


@settings(max_examples=50, deadline=None)
@given(STAMPS, vectors(2), NUMBERS)
def test_twist(stamp_ns, velocity, yaw_rate):
    command = BodyCommand("/command")
    command.stamp_ns, command.velocity, command.yaw_rate = stamp_ns, velocity, yaw_rate
    message = read(TwistStampedMessage().encode(command), definitions.TWIST_STAMPED)
    check_stamp(message.header.stamp, stamp_ns)
    assert xyz(message.twist.linear) == [*velocity, 0.0]
    assert xyz(message.twist.angular) == [0.0, 0.0, yaw_rate]


@settings(max_examples=50, deadline=None)
@given(STAMPS, NUMBERS, NUMBERS, st.floats(0, 1))
def test_battery_state(stamp_ns, voltage, current, charge):
    battery = Battery("/battery")
    battery.stamp_ns, battery.voltage, battery.current, battery.charge = stamp_ns, voltage, current, charge
    payload = BatteryMessage().encode(battery)
    message = read(payload, definitions.BATTERY_STATE)
    check_stamp(message.header.stamp, stamp_ns)
    assert (message.voltage, message.current, message.percentage) == tuple(np.float32([voltage, -current, charge]))
    assert message.present
    assert np.isnan(message.temperature)
    assert decode_battery_state(payload)[1:] == tuple(np.float32([voltage, current, charge]))


@settings(max_examples=50, deadline=None)
@given(STAMPS, st.lists(st.tuples(FRAMES, st.sampled_from(Level), FRAMES, st.dictionaries(FRAMES, FRAMES))))
def test_diagnostics(stamp_ns, rows):
    message = read(encode_diagnostics(stamp_ns, [Status(*row) for row in rows], "uslgo1"), definitions.DIAGNOSTIC_ARRAY)
    check_stamp(message.header.stamp, stamp_ns)
    assert [
        (status.name, status.level, status.message, {pair.key: pair.value for pair in status.values})
        for status in message.status
    ] == rows
    assert all(status.hardware_id == "uslgo1" for status in message.status)


@settings(max_examples=50, deadline=None)
@given(STAMPS, FRAMES, FRAMES)
def test_a_fixed_transform_is_the_identity(stamp_ns, frame, child):
    message = read(encode_fixed(stamp_ns, frame, child), definitions.TF).transforms[0]
    check_stamp(message.header.stamp, stamp_ns)
    assert (message.header.frame_id, message.child_frame_id) == (frame, child)
    assert xyz(message.transform.translation) == [0, 0, 0]
    turned = message.transform.rotation
    assert (turned.x, turned.y, turned.z, turned.w) == (0, 0, 0, 1)


@given(FRAMES)
def test_string(text):
    assert read(encode_string(text), definitions.STRING).data == decode_string(encode_string(text)) == text


@settings(max_examples=50, deadline=None)
@given(STAMPS, st.integers(0, 12), vectors(12), vectors(12))
def test_a_path_that_was_sent_is_received(stamp_ns, count, x, y):
    path = Path("/path", {"path": 12})
    path.stamp_ns, path.count, path.x, path.y = stamp_ns, count, x, y
    received = decode_path(PathMessage().encode(path), 12)
    assert (received.stamp_ns, received.frame) == (stamp_ns, "odom")
    assert received.points == list(zip(x[:count].tolist(), y[:count].tolist(), strict=True))


@pytest.mark.parametrize(
    "name",
    [
        definitions.IMU,
        definitions.JOINT_STATE,
        definitions.ODOMETRY,
        definitions.TF,
        definitions.PATH,
        definitions.TWIST,
        definitions.TWIST_STAMPED,
        definitions.POSE_STAMPED,
        definitions.POSE_WITH_COVARIANCE_STAMPED,
        definitions.BATTERY_STATE,
        definitions.LASER_SCAN,
        definitions.POINT_CLOUD2,
        definitions.DIAGNOSTIC_ARRAY,
        definitions.BOOL,
        definitions.STRING,
        definitions.FLOAT64,
    ],
)
def test_definitions_parse_and_agree_with_humble(name):
    types = get_types_from_msg(definitions.definition(name), name)
    (_, fields), (_, of_humble) = types[name], STORE.fielddefs[name]  # constants were added since
    assert fields == of_humble


def test_type_hash_is_that_of_the_distribution():
    expected = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"
    assert definitions.type_hash(definitions.IMU) == expected
