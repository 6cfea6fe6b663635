# SPDX-License-Identifier: Apache-2.0
"""A network in memory, in virtual time: what is sent reaches those who subscribed, at once, unless something is cut."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

from runtime.messages.attachment import Attachment
from runtime.messages.keys import DEFAULT_QUALITY, Node, gid_of
from runtime.messages.session import Receiver
from sim_bridge.faults.virtual_clocks import VirtualClocks


class _Letter(NamedTuple):
    """A message on its way."""

    sender: str
    topic: str
    type_name: str
    payload: bytes
    attachment: bytes


class VirtualNetwork:
    """Connects sessions by their names.

    Args:
        clocks: that stamp the messages.
    """

    def __init__(self, clocks: VirtualClocks) -> None:
        self.clocks = clocks
        self._receivers: dict[tuple[str, str], list[tuple[str, Receiver]]] = defaultdict(list)
        self._waiting: dict[str, list[_Letter]] = {}
        self._tokens: list[tuple[str, str]] = []
        self._watchers: list[tuple[str, Callable[[str, bool], None]]] = []

    def join(self, name: str) -> VirtualSession:
        """A session of a name, which may have been there before."""
        return VirtualSession(self, name)

    def subscribe(self, name: str, topic: str, type_name: str, receiver: Receiver) -> None:
        """Hand messages to a session's receiver."""
        self._receivers[topic, type_name].append((name, receiver))

    def declare(self, name: str, token: str) -> None:
        """Make a session's publisher known."""
        self._tokens.append((name, token))
        for _, changed in self._watchers:
            changed(token, True)

    def watch(self, name: str, changed: Callable[[str, bool], None]) -> None:
        """Tell a session of every publisher, those that are there already included, and of its end."""
        self._watchers.append((name, changed))
        for _, token in self._tokens:
            changed(token, True)

    def leave(self, name: str) -> None:
        """A session is gone with its publishers, and what is sent to it lost."""
        for receivers in self._receivers.values():
            receivers[:] = [(owner, receiver) for owner, receiver in receivers if owner != name]
        self._watchers = [(owner, changed) for owner, changed in self._watchers if owner != name]
        ended = [token for owner, token in self._tokens if owner == name]
        self._tokens = [(owner, token) for owner, token in self._tokens if owner != name]
        for _, changed in self._watchers:
            for token in ended:
                changed(token, False)

    def cut(self, name: str) -> None:
        """What a session sends waits on its way until it is `mended`, as in the buffers of a broken network."""
        self._waiting.setdefault(name, [])

    def mend(self, name: str) -> None:
        """What waited arrives, in its order."""
        for letter in self._waiting.pop(name, ()):
            self.send(letter)

    def send(self, letter: _Letter) -> None:
        """Deliver a message, or let it wait."""
        if letter.sender in self._waiting:
            self._waiting[letter.sender].append(letter)
            return
        for owner, receiver in list(self._receivers[letter.topic, letter.type_name]):
            if owner != letter.sender:
                receiver.receive(letter.payload, letter.attachment)


class VirtualSession:
    """A node of the network, as a `Session`."""

    def __init__(self, network: VirtualNetwork, name: str) -> None:
        self._network, self._name = network, name
        self._node, self._endpoints = Node(0, name, name), 0

    def publisher(self, topic: str, type_name: str, quality: str = DEFAULT_QUALITY) -> VirtualPublisher:
        """A publisher; nothing is kept for late joiners."""
        self._endpoints += 1
        token = self._node.endpoint_token(self._endpoints, "MP", topic, type_name, quality)
        self._network.declare(self._name, token)
        return VirtualPublisher(self._network, self._name, topic, type_name, gid_of(token))

    def subscribe(self, topic: str, type_name: str, receiver: Receiver, quality: str = DEFAULT_QUALITY) -> None:
        """Hand every message of a topic to a receiver."""
        self._network.subscribe(self._name, topic, type_name, receiver)

    def watch_publishers(self, changed: Callable[[str, bool], None]) -> None:
        """Be told the token of each publisher, and of its end."""
        self._network.watch(self._name, changed)

    def peers(self) -> int:
        """One: the network."""
        return 1


class VirtualPublisher:
    """Sends on one topic."""

    def __init__(self, network: VirtualNetwork, session: str, topic: str, type_name: str, gid: bytes) -> None:
        self._network, self._session, self._topic, self._type_name = network, session, topic, type_name
        self._gid, self._sequence = gid, 0

    def put(self, payload: bytes) -> None:
        """Send a message."""
        self._sequence += 1
        attachment = Attachment(self._sequence, self._network.clocks.instant().unix_ns, self._gid).to_bytes()
        self._network.send(_Letter(self._session, self._topic, self._type_name, payload, attachment))
