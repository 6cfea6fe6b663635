# SPDX-License-Identifier: Apache-2.0
"""Who sent a message: the session behind a publisher, so that all that one operator sends has one source.

ROS 2 gives every publisher an id of its own (gid) and does not say whose it is. Tokens say which sessions publish on a
topic. The gid of rmw_zenoh (of Humble, of Jazzy and later), and of our own sessions, is the hash of the publisher's
token, and so found. Of other clients a gid is that of the session that alone can have it: the only one on the topic
that has none yet, neither of this kind nor of that. Until that is clear it stands for itself.

A gid is a name and no proof: whoever may publish on a topic may write another's. Access control says who may publish.
"""

from __future__ import annotations

import hashlib
import threading
from collections import Counter
from typing import NamedTuple

from runtime.messages.keys import gid_of, publisher_of

MOST_TOKENS, MOST_GIDS = 4096, 256


def number_of(name: str) -> int:
    """A session's or a topic's name as a source."""
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") & (1 << 63) - 1


class _Publisher(NamedTuple):
    """A publisher that a token has made known."""

    session: str
    topic: str


class SenderBook:
    """Which session a publisher belongs to; tokens and messages may come in any thread.

    Attributes:
        overlooked: tokens that found no room, since start.
    """

    def __init__(self) -> None:
        self.overlooked = 0
        self._sessions: dict[str, Counter[str]] = {}
        self._publishers: dict[bytes, _Publisher] = {}
        self._hashing: set[str] = set()
        self._session_of: dict[tuple[str, bytes], str] = {}
        self._lock = threading.Lock()

    def note(self, token: str, alive: bool) -> None:
        """Take up a publisher's token, or its end."""
        place = publisher_of(token)
        if place is None:
            return
        gid, publisher = gid_of(token), _Publisher(*place)
        with self._lock:
            if alive and gid not in self._publishers:
                if len(self._publishers) >= MOST_TOKENS:
                    self.overlooked += 1
                    return
                self._publishers[gid] = publisher
                self._sessions.setdefault(publisher.topic, Counter())[publisher.session] += 1
                self._session_of.pop((publisher.topic, gid), None)
            elif not alive and gid in self._publishers:
                self._forget(*self._publishers.pop(gid))

    def _forget(self, session: str, topic: str) -> None:
        sessions = self._sessions[topic]
        sessions[session] -= 1
        if sessions[session]:
            return
        del sessions[session]
        if not sessions:
            del self._sessions[topic]
        if not any(session in others for others in self._sessions.values()):
            self._hashing.discard(session)
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
            publisher = self._publishers.get(gid)
            if publisher is not None and publisher.topic == topic:
                self._hashing.add(publisher.session)
                return number_of(publisher.session)
            session = self._session_of.get((topic, gid))
            if session is None:
                owned = {owner for (where, _), owner in self._session_of.items() if where == topic} | self._hashing
                free = [session for session in self._sessions.get(topic, ()) if session not in owned]
                if len(free) != 1 or len(self._session_of) >= MOST_GIDS:
                    return alone
                session = self._session_of[topic, gid] = free[0]
        return number_of(session)
