# SPDX-License-Identifier: Apache-2.0
"""The way of a message from the network to its use: bounded in number, decoded, checked, used, and counted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from runtime.link.clocks import Instant, instant
from runtime.link.rate_gate import RateGate
from runtime.link.senders import SenderBook, number_of
from runtime.link.tally import Tally
from runtime.messages.attachment import Attachment, parse_attachment
from runtime.messages.errors import MessageError

Message = TypeVar("Message")
_MOST_PUBLISHERS = 32
_LARGEST_GAP = 1_000_000
"""A larger jump of the numbers is not a loss but a publisher that counts in another way."""


class TopicInput(Generic[Message]):
    """Receives one type on one topic; messages may come in several threads at once, and are used in turn.

    Args:
        topic: its name.
        decode: bytes to a message.
        use: what is done with a message, given its source and the time of its arrival. What it and `decode` raise as a
            `MessageError` is counted.
        gate: how many messages are read; None for all.
        tally: counts.
        senders: whose the publishers are.
    """

    def __init__(
        self,
        topic: str,
        decode: Callable[[bytes], Message],
        use: Callable[[Message, int, Instant], None],
        gate: RateGate | None,
        tally: Tally,
        senders: SenderBook,
    ) -> None:
        self.topic = topic
        self._decode, self._use, self._gate = decode, use, gate
        self._tally, self._senders = tally, senders
        self._unknown = number_of(topic)
        self._numbers: dict[bytes, int] = {}
        self._lock = threading.Lock()

    def receive(self, payload: bytes, attachment: bytes) -> None:
        """Take a message."""
        now = instant()
        with self._lock:
            try:
                if self._gate is not None and not self._gate.passes(now.monotonic_ns):
                    raise MessageError("more messages than are read")
                source = self._source(attachment)
                self._use(self._decode(payload), source, now)
            except MessageError as error:
                self.refuse(str(error))
            except Exception as error:  # ours, not the sender's: told as such, and the other topics go on
                self.refuse(f"a fault of the link: {type(error).__name__}")
            else:
                self._tally.accept(self.topic, now.monotonic_ns)

    def refuse(self, reason: str) -> None:
        """Count a message that is not used."""
        self._tally.reject(self.topic, reason)

    def _source(self, data: bytes) -> int:
        """Who sent a message; one whose attachment cannot be read is used all the same, since it may be an e-stop."""
        if not data:
            return self._unknown
        try:
            attachment = parse_attachment(data)
        except MessageError as error:
            self.refuse(f"{error}; used as from an unknown sender")
            return self._unknown
        self._count_missing(attachment)
        return self._senders.source(self.topic, attachment.gid, attachment.source)

    def _count_missing(self, attachment: Attachment) -> None:
        last = self._numbers.pop(attachment.gid, None)
        if last is None and len(self._numbers) >= _MOST_PUBLISHERS:
            self._numbers.pop(next(iter(self._numbers)))
        self._numbers[attachment.gid] = attachment.sequence
        if last is not None and 1 < attachment.sequence - last < _LARGEST_GAP:
            self._tally.miss(self.topic, attachment.sequence - last - 1)
