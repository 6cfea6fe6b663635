# SPDX-License-Identifier: Apache-2.0
"""Keys, tokens and attachments are those of rmw_zenoh, to the letter."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.messages import definitions
from runtime.messages.attachment import Attachment, parse_attachment
from runtime.messages.errors import MessageError
from runtime.messages.keys import (
    SENSOR_QUALITY,
    TRANSIENT_LOCAL_QUALITY,
    Node,
    data_key,
    gid_of,
    publisher_of,
    publisher_tokens,
)

IMU_HASH = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"
NODE = Node(0, "aac3178e146ba6f1fc6e6a4085e77f21", "ugv_link")


def test_a_topic_s_key():
    assert data_key(0, "/imu/data", definitions.IMU) == f"0/imu/data/sensor_msgs::msg::dds_::Imu_/{IMU_HASH}"


def test_humble_has_a_word_in_place_of_the_hash():
    key = data_key(7, "/cmd_vel", definitions.TWIST, "humble")
    assert key == "7/cmd_vel/geometry_msgs::msg::dds_::Twist_/TypeHashNotSupported"


def test_a_node_s_token():
    assert NODE.token() == "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/ugv_link"


def test_tokens_of_a_publisher_and_a_subscription():
    where = "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0"
    what = f"%imu%data/sensor_msgs::msg::dds_::Imu_/{IMU_HASH}"
    assert (
        NODE.endpoint_token(4, "MS", "/imu/data", definitions.IMU, SENSOR_QUALITY)
        == f"{where}/4/MS/%/%/ugv_link/{what}/2::,5:,:,:,,"
    )
    assert (
        NODE.endpoint_token(5, "MP", "/imu/data", definitions.IMU) == f"{where}/5/MP/%/%/ugv_link/{what}/::,10:,:,:,,"
    )
    kept = NODE.endpoint_token(6, "MP", "/imu/data", definitions.IMU, TRANSIENT_LOCAL_QUALITY)
    assert kept.endswith("/:1:,1:,:,:,,")


def test_a_publisher_is_known_by_its_token():
    token = NODE.endpoint_token(5, "MP", "/imu/data", definitions.IMU)
    assert publisher_of(token) == (NODE.session, "/imu/data")
    assert publisher_of(NODE.endpoint_token(5, "MS", "/imu/data", definitions.IMU)) is None
    assert publisher_of(NODE.token()) is None
    assert publisher_tokens(3) == "@ros2_lv/3/*/*/*/MP/**"


def test_a_publisher_s_id_is_the_hash_of_its_token():
    """XXH3_128bits() of the C library, low word before high word as Entity::Entity() of rmw_zenoh copies them."""
    token = NODE.endpoint_token(5, "MP", "/imu/data", definitions.IMU)
    assert gid_of(token).hex() == "cf570b66f672ffe23d4ea68d0135d886"


@given(st.text(max_size=200))
def test_any_text_is_a_publisher_s_token_or_none(text):
    assert publisher_of(text) is None or text.startswith("@ros2_lv/")


def test_an_attachment_has_33_bytes():
    gid = bytes(range(16))
    data = Attachment(3, 1_700_000_000_000_000_000, gid).to_bytes()
    assert data == struct.pack("<qqB16s", 3, 1_700_000_000_000_000_000, 16, gid)
    assert len(data) == 33
    assert parse_attachment(data).source == 0x0706050403020100


@given(st.binary(min_size=33, max_size=33) | st.binary(max_size=64))
def test_any_bytes_are_an_attachment_or_the_one_error(data):
    try:
        attachment = parse_attachment(data)
    except MessageError:
        assert len(data) != 33 or data[16] != 16
    else:
        assert attachment.to_bytes() == data
        assert 0 <= attachment.source < 1 << 63


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # as `ros2 topic info --verbose` gives them in Jazzy
        (definitions.STRING, "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        (definitions.TWIST, "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"),
        (definitions.EMPTY, "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312"),
        (definitions.IMU, IMU_HASH),
    ],
)
def test_type_hashes(name, expected):
    assert definitions.type_hash(name) == expected
