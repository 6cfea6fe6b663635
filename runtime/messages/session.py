# SPDX-License-Identifier: Apache-2.0
"""A zenoh session as a ROS 2 node: publishers and subscriptions that ROS peers find."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import zenoh
import zenoh.ext

from runtime.errors import UgvError
from runtime.messages.attachment import Attachment
from runtime.messages.foreign_thread import keep_thread_state
from runtime.messages.keys import (
    DEFAULT_QUALITY,
    TRANSIENT_LOCAL_QUALITY,
    Node,
    TypeHashes,
    data_key,
    gid_of,
    publisher_tokens,
)
from runtime.messages.refusal import reason, reason_of_file

_MOST_SESSIONS = 64
LARGEST_PAYLOAD_BYTES = 8 << 20
"""Larger messages are refused; twice as large ones zenoh does not even put together."""


class SessionError(UgvError):
    """A zenoh session cannot be opened."""


class Receiver(Protocol):
    """Takes what arrives on a topic, in threads of zenoh's."""

    def receive(self, payload: bytes, attachment: bytes) -> None:
        """Take a message; the attachment is empty if there is none."""

    def refuse(self, reason: str) -> None:
        """Take note of a message that was not looked at."""


def session_config(listen: Sequence[str], connect: Sequence[str], file: Path | None = None) -> zenoh.Config:
    """What zenoh is told: where to listen and to connect, and to look for nobody; or what a file says instead.

    Raises:
        SessionError: if the file, or an endpoint, is not one of zenoh's.
    """
    if file is not None:
        return _from_file(file)
    try:
        config = zenoh.Config()
        for key, value in (
            ("mode", "peer"),
            ("listen/endpoints", list(listen)),
            ("connect/endpoints", list(connect)),
            ("scouting/multicast/enabled", False),
            ("scouting/gossip/enabled", False),
            ("timestamping/enabled", True),  # late joiners are given kept messages by their time
            ("transport/shared_memory/enabled", False),  # it would leave files behind when killed
            ("transport/unicast/max_sessions", _MOST_SESSIONS),
            ("transport/link/rx/max_message_size", 2 * LARGEST_PAYLOAD_BYTES),
        ):
            config.insert_json5(key, json.dumps(value))
        return config
    except zenoh.ZError as error:
        raise SessionError(f"link: not a valid configuration of zenoh: {reason(error)}") from None


def _from_file(file: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(file))
    except zenoh.ZError as error:
        raise SessionError(f"{file}: not a valid configuration of zenoh: {reason_of_file(error)}") from None


class Publisher(Protocol):
    """Publishes on one topic."""

    def put(self, payload: bytes) -> None:
        """Send a message."""


class Session(Protocol):
    """A node of the ROS graph; see `RosSession`."""

    def publisher(self, topic: str, type_name: str, quality: str = DEFAULT_QUALITY) -> Publisher:
        """A publisher."""

    def subscribe(self, topic: str, type_name: str, receiver: Receiver, quality: str = DEFAULT_QUALITY) -> None:
        """Hand every message of a topic to a receiver."""

    def watch_publishers(self, changed: Callable[[str, bool], None]) -> None:
        """Be told the token of each publisher of the domain, and of its end."""

    def peers(self) -> int:
        """How many sessions this one is connected with."""


class RosPublisher:
    """Publishes on one topic; what the network cannot take is dropped, so that nobody is waited for."""

    def __init__(self, publisher: Any, gid: bytes) -> None:
        self._publisher, self._gid = publisher, gid
        self._sequence = 0

    def put(self, payload: bytes) -> None:
        """Send a message."""
        self._sequence += 1
        attachment = Attachment(self._sequence, time.time_ns(), self._gid)
        self._publisher.put(payload, attachment=attachment.to_bytes())

    @property
    def heard(self) -> bool:
        """Whether somebody has subscribed; only for a publisher that keeps no message."""
        return bool(self._publisher.matching_status.matching)


class RosSession:
    """A node of the ROS graph.

    Its threads have the scheduling of the thread that opens it.

    Args:
        node: its name.
        domain: number of the ROS domain.
        config: as of `session_config`.
        hashes: how types are told apart.

    Raises:
        SessionError: if the session cannot be opened, as when its address is in use.
    """

    def __init__(self, node: str, domain: int, config: zenoh.Config, hashes: TypeHashes = "rihs01") -> None:
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise SessionError(f"no zenoh session could be opened: {reason(error)}") from None
        self._domain, self._hashes, self._endpoints = domain, hashes, 0
        self._node = Node(domain, str(self._session.zid()), node)
        self._held: list[Any] = []
        self._token(self._node.token())

    def _token(self, key: str) -> None:
        self._held.append(self._session.liveliness().declare_token(key))

    def _endpoint(self, kind: Any, topic: str, type_name: str, quality: str) -> str:
        self._endpoints += 1
        token = self._node.endpoint_token(self._endpoints, kind, topic, type_name, quality, self._hashes)
        self._token(token)
        return token

    def publisher(self, topic: str, type_name: str, quality: str = DEFAULT_QUALITY) -> RosPublisher:
        """A publisher; a transient local one keeps its last message for those that come later.

        Raises:
            SessionError: if zenoh's configuration forbids that.
        """
        token = self._endpoint("MP", topic, type_name, quality)
        key = data_key(self._domain, topic, type_name, self._hashes)
        drop = zenoh.CongestionControl.DROP
        publisher: Any
        if quality == TRANSIENT_LOCAL_QUALITY:
            try:
                publisher = zenoh.ext.declare_advanced_publisher(
                    self._session,
                    key,
                    congestion_control=drop,
                    cache=zenoh.ext.CacheConfig(1),
                    publisher_detection=True,
                )
            except zenoh.ZError as error:
                raise SessionError(f"nothing can be kept for late joiners of {topic}: {reason(error)}") from None
        else:
            publisher = self._session.declare_publisher(key, congestion_control=drop)
        self._held.append(publisher)
        return RosPublisher(publisher, gid_of(token))

    def subscribe(self, topic: str, type_name: str, receiver: Receiver, quality: str = DEFAULT_QUALITY) -> None:
        """Hand every message of a topic to a receiver, in the thread that read it from the network."""

        def take(sample: zenoh.Sample) -> None:
            keep_thread_state()
            if sample.kind != zenoh.SampleKind.PUT:
                receiver.refuse("a topic's value cannot be deleted")
            elif len(sample.payload) > LARGEST_PAYLOAD_BYTES:
                receiver.refuse("the message is too large")
            else:
                attachment = sample.attachment
                receiver.receive(bytes(sample.payload), b"" if attachment is None else bytes(attachment))

        self._endpoint("MS", topic, type_name, quality)
        key = data_key(self._domain, topic, type_name, self._hashes)
        callback = zenoh.handlers.Callback(take, indirect=False)
        self._held.append(self._session.declare_subscriber(key, callback, allowed_origin=zenoh.Locality.REMOTE))

    def watch_publishers(self, changed: Callable[[str, bool], None]) -> None:
        """Be told the token of each publisher of the domain, those that are there already included, and of its end."""

        def take(sample: zenoh.Sample) -> None:
            changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        callback = zenoh.handlers.Callback(take, indirect=False)
        tokens = publisher_tokens(self._domain)
        self._held.append(self._session.liveliness().declare_subscriber(tokens, callback, history=True))

    def peers(self) -> int:
        """How many sessions this one is connected with."""
        info = self._session.info
        return len(info.peers_zid()) + len(info.routers_zid())

    def close(self) -> None:
        """Leave the network; no receiver is called afterwards."""
        for part in reversed(self._held):
            with suppress(zenoh.ZError):  # what the session lost by itself
                part.undeclare()
        self._held.clear()
        self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> RosSession:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
