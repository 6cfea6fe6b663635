# SPDX-License-Identifier: Apache-2.0
"""Who sent a message: the session behind a publisher, so that all that one operator sends has one source.

ROS 2 gives every publisher an id of its own (gid) and does not say whose it is. Tokens say which sessions publish on a
topic. A gid is that of the session that alone can have it: the only one on the topic that has no gid yet. Until that is
clear the gid stands for itself, whose first half our own sessions share among their publishers.
"""

from __future__ import annotations

import hashlib
import threading
from collections import Counter

from runtime.messages.keys import publisher_of

MOST_TOKENS, MOST_GIDS = 4096, 256


def number_of(name: str) -> int:
    """A session's or a topic's name as a source."""
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") & (1 << 63) - 1


class SenderBook:
    """Which session a publisher belongs to; tokens and messages may come in any thread.

    Attributes:
        overlooked: tokens that found no room, since start.
    """

    def __init__(self) -> None:
        self.overlooked = 0
        self._sessions: dict[str, Counter[str]] = {}
        self._tokens: set[str] = set()
        self._session_of: dict[tuple[str, bytes], str] = {}
        self._lock = threading.Lock()

    def note(self, token: str, alive: bool) -> None:
        """Take up a publisher's token, or its end."""
        place = publisher_of(token)
        if place is None:
            return
        session, topic = place
        with self._lock:
            if alive and token not in self._tokens:
                if len(self._tokens) >= MOST_TOKENS:
                    self.overlooked += 1
                    return
                self._tokens.add(token)
                self._sessions.setdefault(topic, Counter())[session] += 1
            elif not alive and token in self._tokens:
                self._tokens.remove(token)
                self._forget(topic, session)

    def _forget(self, topic: str, session: str) -> None:
        sessions = self._sessions[topic]
        sessions[session] -= 1
        if sessions[session]:
            return
        del sessions[session]
        if not sessions:
            del self._sessions[topic]
        for key in [key for key, owner in self._session_of.items() if key[0] == topic and owner == session]:
            del self._session_of[key]

    def source(self, topic: str, gid: bytes, alone: int) -> int:
        """The source of a message.

        Args:
            topic: of the message.
            gid: of its publisher.
            alone: what to call the publisher while its session is not known.
        """
        with self._lock:
            session = self._session_of.get((topic, gid))
            if session is None:
                owned = {owner for (where, _), owner in self._session_of.items() if where == topic}
                free = [session for session in self._sessions.get(topic, ()) if session not in owned]
                if len(free) != 1 or len(self._session_of) >= MOST_GIDS:
                    return alone
                session = self._session_of[topic, gid] = free[0]
        return number_of(session)
