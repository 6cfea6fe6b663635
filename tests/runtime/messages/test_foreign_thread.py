# SPDX-License-Identifier: Apache-2.0
"""A thread of zenoh's is the same thread to Python at each message."""

import threading
from collections import Counter

import pytest

from runtime.messages.session import RosSession, session_config
from sim_bridge.free_port import free_port

TYPE = "std_msgs/msg/String"
MESSAGES, ATTEMPTS = 40, 2000


class Remembering:
    """Counts what each thread received, beside what the thread itself remembers."""

    def __init__(self) -> None:
        self.counted: Counter[int] = Counter()
        self.remembered: dict[int, int] = {}
        self.done = threading.Event()
        self._own = threading.local()

    def receive(self, payload: bytes, attachment: bytes) -> None:
        """Count."""
        thread = threading.get_ident()
        self._own.count = getattr(self._own, "count", 0) + 1
        self.counted[thread] += 1
        self.remembered[thread] = self._own.count
        if self.counted.total() >= MESSAGES:
            self.done.set()

    def refuse(self, reason: str) -> None:
        """Not expected."""
        raise AssertionError(reason)


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def test_a_thread_remembers_what_it_received_before(endpoint):
    receiver = Remembering()
    with (
        RosSession("hearer", 0, session_config([endpoint], [])) as hearer,
        RosSession("speaker", 0, session_config([], [endpoint])) as speaker,
    ):
        hearer.subscribe("/word", TYPE, receiver)
        publisher = speaker.publisher("/word", TYPE)
        for _ in range(ATTEMPTS):
            if receiver.done.wait(0.01):
                break
            publisher.put(b"\0\1\0\0")
    assert receiver.counted.total() >= MESSAGES
    assert receiver.remembered == receiver.counted
