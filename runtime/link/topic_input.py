# SPDX-License-Identifier: Apache-2.0
"""The way of a message from the network to its use: bounded in number, decoded, checked, used, and counted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from runtime.link.clocks import Instant, instant
from runtime.link.lateness import Lateness
from runtime.link.rate_gate import RateGate
from runtime.link.senders import SenderBook, number_of
from runtime.link.tally import Tally
from runtime.messages.attachment import parse_attachment
from runtime.messages.errors import MessageError

Message = TypeVar("Message")
FAULT = "a fault of the link"
"""How a reason begins that is not the sender's."""
_MOST_PUBLISHERS, _FORGOTTEN_NS = 32, 10_000_000_000
_LARGEST_GAP = 1_000_000
"""A larger jump of the numbers is not a loss but a publisher that counts in another way."""


def never(message: object, late_ns: int) -> bool:
    """A message is used however late it is."""
    return False


class TopicInput(Generic[Message]):
    """Receives one type on one topic; messages may come in several threads at once, and are used in turn.

    Args:
        topic: its name.
        decode: bytes to a message.
        use: what is done with a message, given its source and the time of its arrival. What it and `decode` raise as a
            `MessageError` is counted.
        make_gate: bounds the messages that are read of one publisher; None if all are read.
        tally: counts.
        senders: whose the publishers are.
        clock: gives the present.
        is_stale: whether a message that was late by so many ns is not used any more.
    """

    def __init__(
        self,
        topic: str,
        decode: Callable[[bytes], Message],
        use: Callable[[Message, int, Instant], None],
        make_gate: Callable[[], RateGate] | None,
        tally: Tally,
        senders: SenderBook,
        clock: Callable[[], Instant] = instant,
        is_stale: Callable[[Message, int], bool] = never,
    ) -> None:
        self.topic = topic
        self._decode, self._use, self._make_gate = decode, use, make_gate
        self._tally, self._senders, self._clock, self._is_stale = tally, senders, clock, is_stale
        self._unknown = number_of(topic)
        self._publishers: dict[bytes, _Publisher] = {}
        self._crowd = self._new()
        self._lock = threading.Lock()

    def receive(self, payload: bytes, attachment: bytes) -> None:
        """Take a message."""
        now = self._clock()
        with self._lock:
            try:
                source, late_ns = self._admit(attachment, now)
                message = self._decode(payload)
                if self._is_stale(message, late_ns):
                    raise MessageError("the message was too long on its way")
                self._use(message, source, now)
            except MessageError as error:
                self.refuse(str(error))
            except Exception as error:  # ours, not the sender's: told as such, and the other topics go on
                self.refuse(f"{FAULT}: {type(error).__name__}")
            else:
                self._tally.accept(self.topic, now.monotonic_ns)

    def refuse(self, reason: str) -> None:
        """Count a message that is not used."""
        self._tally.reject(self.topic, reason)

    def _admit(self, data: bytes, now: Instant) -> tuple[int, int]:
        """Who sent a message, and how late it is, ns, if it may be read.

        One whose attachment cannot be read may be an e-stop, and is; how late it is cannot be known.
        """
        attachment, late_ns = None, 0
        if data:
            try:
                attachment = parse_attachment(data)
            except MessageError as error:
                self.refuse(f"{error}; used as from an unknown sender")
        publisher = self._publisher(b"" if attachment is None else attachment.gid, now.monotonic_ns)
        if attachment is not None and publisher is not self._crowd:
            self._tally.miss(self.topic, publisher.missing(attachment.sequence))
            late_ns = publisher.lateness.of(attachment.sent_ns, now.monotonic_ns)
        if publisher.gate is not None and not publisher.gate.passes(now.monotonic_ns):
            raise MessageError("more messages than are read")
        if attachment is None:
            return self._unknown, late_ns
        return self._senders.source(self.topic, attachment.gid, attachment.source), late_ns

    def _publisher(self, gid: bytes, now_ns: int) -> _Publisher:
        """What is kept of a publisher; while too many are heard, newcomers are bounded together."""
        publisher = self._publishers.get(gid)
        if publisher is None:
            if len(self._publishers) >= _MOST_PUBLISHERS:
                silent = [gid for gid, known in self._publishers.items() if now_ns - known.heard_ns > _FORGOTTEN_NS]
                if not silent:
                    return self._crowd
                del self._publishers[silent[0]]
            publisher = self._publishers[gid] = self._new()
        publisher.heard_ns = now_ns
        return publisher

    def _new(self) -> _Publisher:
        return _Publisher(None if self._make_gate is None else self._make_gate())


class _Publisher:
    """What is kept of one publisher.

    Attributes:
        gate: bounds the messages that are read of it.
        heard_ns: when it was last heard.
        lateness: of its messages.
    """

    def __init__(self, gate: RateGate | None) -> None:
        self.gate, self.heard_ns, self.lateness = gate, 0, Lateness()
        self._last: int | None = None

    def missing(self, sequence: int) -> int:
        """How many messages are missing before the one with this number."""
        last, self._last = self._last, sequence
        missing = 0 if last is None else sequence - last - 1
        return missing if 0 < missing < _LARGEST_GAP else 0
