# SPDX-License-Identifier: Apache-2.0
"""The whole way of a message through the link: who sent it, how often, what it says, whether it may be used."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from fuzz_target import Target, room
from message_targets import STORE, clouds, sample

from runtime.link import topics
from runtime.link.clocks import Instant
from runtime.link.inputs import inputs_of
from runtime.link.setup import LinkSetup, link_setup
from runtime.link.topic_input import FAULT, TopicInput
from runtime.messages import definitions
from runtime.messages.attachment import Attachment
from runtime.messages.keys import DEFAULT_QUALITY
from runtime.robots import load_configuration

NOW = Instant(5_000_000_000, 1_700_000_000_000_000_000)
FRAMES = {topics.IMU: "imu_link", topics.CMD_VEL: "base_link", topics.TELEOP: "base_link"}
POINTS = 3


class Subscriptions:
    """Stands for a session: keeps who receives what, in the order of the subscriptions."""

    def __init__(self) -> None:
        self.taken: list[tuple[str, str, TopicInput[Any]]] = []

    def watch_publishers(self, changed: Callable[[str, bool], None]) -> None:
        """Nobody comes or goes."""

    def subscribe(self, topic: str, type_name: str, receiver: Any, quality: str = DEFAULT_QUALITY) -> None:
        """Keep a receiver."""
        self.taken.append((topic, type_name, receiver))


@functools.cache
def setup() -> LinkSetup:
    """What the link of USLGO1 is told."""
    return link_setup(load_configuration("uslgo1"))


def receive(data: bytes) -> tuple[str, dict[str, int]]:
    """Let a link that was just started receive a message; gives its topic, and by reason what was refused of it.

    The first byte chooses the topic and type, the second says how many bytes of attachment follow; the rest is payload.
    """
    with (
        tempfile.TemporaryDirectory(dir=room()) as directory,
        closing(inputs_of(setup(), Path(directory), lambda: NOW)) as inputs,
    ):
        session = Subscriptions()
        inputs.subscribe(session)
        chosen, length = (*data[:2], 0, 0)[:2]
        topic, _, receiver = session.taken[chosen % len(session.taken)]
        receiver.receive(data[2 + length :], data[2 : 2 + length])
        inputs.outlet.flush(NOW.monotonic_ns)
        accepted, rejected, _ = inputs.tally.snapshot()
    assert sum(accepted.values()) + sum(rejected.values()) >= 1, "a message was neither used nor counted"
    return topic, {reason: count for (_, reason), count in rejected.items()}


def decode_message(data: bytes) -> None:
    """A message of any topic, which the link may refuse, but not stumble over."""
    _, refused = receive(data)
    assert not any(reason.startswith(FAULT) for reason in refused), refused


def message_seeds() -> list[bytes]:
    """A message of every topic and type that a link uses, with an attachment and without."""
    session = Subscriptions()
    with tempfile.TemporaryDirectory(dir=room()) as directory, closing(inputs_of(setup(), Path(directory))) as inputs:
        inputs.subscribe(session)
    attachment = Attachment(1, NOW.unix_ns, bytes(range(16))).to_bytes()
    return [
        bytes((chosen, len(attached))) + attached + message_on(topic, type_name)
        for chosen, (topic, type_name, _) in enumerate(session.taken)
        for attached in (b"", attachment)
    ]


def message_on(topic: str, type_name: str) -> bytes:
    """A message that the link uses at `NOW`."""
    if type_name == definitions.POINT_CLOUD2:
        return clouds()[-1]
    content = sample(type_name, POINTS)
    if hasattr(content, "header"):
        content.header.stamp.sec, content.header.stamp.nanosec = divmod(NOW.unix_ns, 1_000_000_000)
        content.header.frame_id = FRAMES.get(topic, "odom")
    for place, pose in enumerate(getattr(content, "poses", ())):
        pose.pose.position.x = float(place)
    if topic == topics.LOCALIZATION:
        turn = content.pose.orientation
        turn.x = turn.y = turn.z = 0.0
    if topic == topics.MOTION:
        content.data = "walk"
    return bytes(STORE.serialize_cdr(content, type_name))


TARGETS = (Target("link", decode_message, ("runtime.link", "runtime.messages"), message_seeds),)
