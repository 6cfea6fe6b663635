# SPDX-License-Identifier: Apache-2.0
"""Names in zenoh of what ROS 2 calls topics and nodes, as rmw_zenoh forms them.

A topic's data travel under `<domain>/<topic>/<type>/<hash>`. Nodes and their publishers and subscriptions are made
known by liveliness tokens, and a publisher's messages carry the hash of its token.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import xxhash

from runtime.messages import definitions

TypeHashes = Literal["rihs01", "humble"]
"""How types are told apart: by the hashes of Jazzy and later, or by the word that Humble puts in their place."""

HUMBLE_HASH = "TypeHashNotSupported"
DEFAULT_QUALITY = "::,10:,:,:,,"
SENSOR_QUALITY = "2::,5:,:,:,,"
TRANSIENT_LOCAL_QUALITY = ":1:,1:,:,:,,"


def dds_type(type_name: str) -> str:
    """`sensor_msgs/msg/Imu` as `sensor_msgs::msg::dds_::Imu_`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def type_hash(type_name: str, hashes: TypeHashes) -> str:
    """The last part of a topic's key."""
    return HUMBLE_HASH if hashes == "humble" else definitions.type_hash(type_name)


def data_key(domain: int, topic: str, type_name: str, hashes: TypeHashes = "rihs01") -> str:
    """Where the messages of a topic travel."""
    return f"{domain}/{topic.strip('/')}/{dds_type(type_name)}/{type_hash(type_name, hashes)}"


def _mangled(name: str) -> str:
    return name.replace("/", "%") or "%"


def publisher_tokens(domain: int) -> str:
    """The key expression of every publisher's token."""
    return f"@ros2_lv/{domain}/*/*/*/MP/**"


def publisher_of(token: str) -> tuple[str, str] | None:
    """Session and topic (with its leading slash) of a publisher's token, or None if it is no such token."""
    parts = token.split("/")
    if len(parts) != 13 or parts[0] != "@ros2_lv" or parts[5] != "MP":
        return None
    return parts[2], parts[9].replace("%", "/")


def gid_of(token: str) -> bytes:
    """The id of the publisher (or of anything else) that a token makes known, as rmw_zenoh forms it, 16 bytes."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


@dataclass(frozen=True)
class Node:
    """A node of the ROS graph.

    Attributes:
        domain: number of the ROS domain.
        session: id of the zenoh session.
        name: of the node, which is in no namespace.
        number: of the node within its session.
    """

    domain: int
    session: str
    name: str
    number: int = 0

    def token(self) -> str:
        """The token that makes the node known."""
        return f"@ros2_lv/{self.domain}/{self.session}/{self.number}/{self.number}/NN/%/%/{self.name}"

    def endpoint_token(
        self,
        number: int,
        kind: Literal["MP", "MS"],
        topic: str,
        type_name: str,
        quality: str = DEFAULT_QUALITY,
        hashes: TypeHashes = "rihs01",
    ) -> str:
        """The token that makes a publisher (MP) or a subscription (MS) of the node known.

        Args:
            number: of the endpoint within the session.
            kind: of the endpoint.
            topic: with its leading slash.
            type_name: of its messages.
            quality: of service, in the short form of rmw_zenoh.
            hashes: how types are told apart.
        """
        where = f"@ros2_lv/{self.domain}/{self.session}/{self.number}/{number}/{kind}/%/%/{self.name}"
        return f"{where}/{_mangled(topic)}/{dds_type(type_name)}/{type_hash(type_name, hashes)}/{quality}"
