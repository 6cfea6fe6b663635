# SPDX-License-Identifier: Apache-2.0
"""A link in a thread, on a port of its own, and what stands at its ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.executors.shared_ports import EventPort, LatestPort
from runtime.executors.tick import ENTRY, Manifest, manifest_of
from runtime.executors.tick_stream import LINK_SOCKET, TickStream
from runtime.link.process import run
from runtime.link.setup import LinkSetup, link_setup
from runtime.messages.session import RosSession, session_config
from runtime.records import Record
from runtime.robots import load_configuration
from sim_bridge.free_port import free_port

PATIENCE_S = 30.0


def until(condition: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
    """Do something until a condition holds; a subscription, for one, takes its time to become known."""
    deadline, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while not condition():
        assert time.monotonic() < deadline, "it did not come true"
        act()
        pause.wait(0.01)


class Inbox:
    """What arrived on a topic."""

    def __init__(self) -> None:
        self.payloads: list[bytes] = []
        self.attachments: list[bytes] = []

    def receive(self, payload: bytes, attachment: bytes) -> None:
        self.attachments.append(attachment)
        self.payloads.append(payload)

    def refuse(self, reason: str) -> None:
        raise AssertionError(reason)


class RunningLink:
    """A link in a thread; its ends are at `directory` and at `port`."""

    def __init__(self, setup: LinkSetup, directory: Path, port: int) -> None:
        self.setup, self.directory, self.port = setup, directory, port
        self.said: list[str] = []
        self.manifest: Manifest = manifest_of(setup.loops)
        self.control = TickStream(directory / LINK_SOCKET)
        self._ports: dict[str, LatestPort] = {}
        self._stop, self._failed = threading.Event(), []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        until(lambda: self._failed or any("carrying" in sentence for sentence in self.said))
        if self._failed:
            raise self._failed[0]

    def _run(self) -> None:
        try:
            run(self.setup, self.directory, self._stop, self.said.append)
        except BaseException as failure:
            self._failed.append(failure)

    def peer(self, name: str = "peer") -> RosSession:
        """A ROS node that is connected with the link."""
        return RosSession(name, 0, session_config([], [f"tcp/127.0.0.1:{self.port}"]))

    def tick(self, loop: str, index: int, *records: Record, now_ns: int | None = None) -> None:
        """Play a tick of a control loop, with some of its signals."""
        tick = self.manifest.of_topic(f"/ugv/tick/{loop}").record
        tick.index, tick.now_ns = index, time.monotonic_ns() if now_ns is None else now_ns
        parts = []
        for record in (tick, *records):
            body = record.to_bytes()
            parts.append(ENTRY.pack(self.manifest.of_topic(record.topic).number, len(body)) + body)
        self.control.write(b"".join(parts))

    def record(self, topic: str) -> Record:
        """A record of a signal's layout."""
        return self.manifest.of_topic(topic).record.like()

    def latest(self, record: Record) -> bool:
        """Load what a control loop would read, if there is news."""
        port = self._ports.setdefault(record.topic, LatestPort(self.directory))
        return port.read(record, time.monotonic_ns())

    def events(self) -> EventPort:
        """The requests that the control loop would read."""
        return EventPort(self.directory)

    def stop(self) -> None:
        """End it; calling it again does nothing."""
        self._stop.set()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        self.control.close()
        if self._failed:
            raise self._failed.pop()


def setup_at(port: int, **changes: str) -> LinkSetup:
    """What the link is told, at a port of its own."""
    overrides = {"link.listen": f'["tcp/127.0.0.1:{port}"]', "realtime.link_priority": "1"}
    return link_setup(load_configuration("uslgo1", overrides | {f"link.{key}": text for key, text in changes.items()}))


@pytest.fixture(name="until")
def until_fixture():
    return until


@pytest.fixture
def inbox_type() -> type[Inbox]:
    return Inbox


@pytest.fixture
def start_link(tmp_path):
    """Starts links, by default in a directory and at a port of their own, and ends them."""
    running: list[RunningLink] = []

    def start(directory: Path = tmp_path, port: int | None = None, **changes: str) -> RunningLink:
        port = free_port() if port is None else port
        running.append(RunningLink(setup_at(port, **changes), directory, port))
        return running[-1]

    yield start
    for link in running:
        link.stop()


@pytest.fixture
def link(start_link):
    return start_link()
