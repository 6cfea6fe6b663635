# SPDX-License-Identifier: Apache-2.0
"""The recorder as a process of its own: it outlives its senders, says how it fares, and loses next to nothing."""

from __future__ import annotations

import array
import fcntl
import os
import resource
import signal
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count, islice
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.executors.tick_stream import TickStream
from runtime.recording.errors import LogError
from runtime.recording.log import Log
from runtime.recording.recorder_status import RecorderStatus, read_status
from runtime.recording.recover import recover

SERVE = """
import sys
from pathlib import Path
from conftest import JOINTS, make_loops
from runtime.recording.service import serve
from runtime.recording.setup import recording_setup
setup = recording_setup(make_loops(), "toy", "gain = 0.3\\n", 0, JOINTS)
serve(setup, Path(sys.argv[1]), Path(sys.argv[2]), [Path(__file__)])
"""
PATIENCE_S, LOOK_S = 120.0, 0.5
OPEN_CHUNK = 4
"""Datagrams of the fast loop until a chunk spans 5 ms."""


class Service:
    """A recorder, and a stream to it."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.logs = directory, directory / "logs"
        directory.mkdir(exist_ok=True)
        script = directory / "serve.py"
        script.write_text(SERVE)
        environment = dict(os.environ, PYTHONPATH=":".join([*sys.path, str(Path(__file__).parent)]))
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            address = directory / "manager.sock"
            address.unlink(missing_ok=True)
            manager.bind(str(address))
            manager.settimeout(LOOK_S)
            environment["NOTIFY_SOCKET"] = str(address)
            command = [sys.executable, str(script), str(directory), str(self.logs)]
            self.process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
            self.told = [self._hear(manager), self._hear(manager)]
        self.stream = TickStream(directory / "recorder.sock")

    def _hear(self, manager: socket.socket) -> bytes:
        """What the recorder tells systemd next."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            with suppress(TimeoutError):
                return manager.recv(100)
            assert self.process.stderr is not None
            assert self.process.poll() is None, self.process.stderr.read()
        raise AssertionError("the recorder says nothing")

    def send(self, datagram: bytes) -> None:
        """Hand over a datagram for certain."""
        before = self.stream.dropped
        self.stream.write(datagram)
        assert self.stream.dropped == before

    def taken(self) -> bool:
        """Whether the recorder has taken everything off its socket."""
        waiting = array.array("i", [0])
        assert self.stream._end is not None
        fcntl.ioctl(self.stream._end, termios.TIOCOUTQ, waiting)
        return waiting[0] == 0

    @property
    def status(self) -> RecorderStatus:
        """What the recorder says of itself."""
        return read_status(self.directory) or RecorderStatus()

    def bags(self) -> list[Path]:
        """Logs in the order in which they were begun."""
        return sorted(self.logs.glob("*/*.mcap"), key=lambda path: (len(path.name), path.name))

    def end(self, number: int = signal.SIGTERM) -> str:
        """End the recorder; gives what it said."""
        self.stream.close()
        self.process.send_signal(number)
        _, said = self.process.communicate(timeout=PATIENCE_S)
        return said


@contextmanager
def service(directory: Path) -> Iterator[Service]:
    running = Service(directory)
    try:
        yield running
    finally:
        if running.process.poll() is None:
            running.end(signal.SIGKILL)


def wait_for(happened: Callable[[], bool]) -> None:
    """Wait for an event."""
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline, "it did not happen"
        os.sched_yield()


def fast(toy) -> Iterator[bytes]:
    """The datagrams of the fast loop alone, without end."""
    run = [datagram for datagram in toy.datagrams() if datagram[:2] == b"\0\0"]
    return (toy.renumbered(run[n % len(run)], n, n * 2_000_000) for n in count())


def has_messages(recorder: Service) -> bool:
    """Whether the first chunk has reached the file."""
    with suppress(LogError):
        return any(Log(bag).end_ns >= 0 for bag in recorder.bags())
    return False


def grown(path: Path, size: int) -> int:
    """The size of a file once it is another than before."""
    wait_for(lambda: path.stat().st_size != size)
    return path.stat().st_size


def sends(recorder: Service, run: Iterator[bytes]) -> bool:
    """Send some more, whether or not it is taken."""
    for datagram in islice(run, 4):
        recorder.stream.write(datagram)
    return True


def ticks(path):
    return Log(path).read_signal("/ugv/tick/fast").values["index"].tolist()


def test_told_to_end_it_closes_the_log_and_says_where(toy, tmp_path):
    run = toy.datagrams()
    with service(tmp_path) as recorder:
        assert recorder.told == [b"READY=1", b"WATCHDOG=1"]
        for datagram in run:
            recorder.send(datagram)
        said = recorder.end()
        assert recorder.process.returncode == 0
    [bag] = recorder.bags()
    log = Log(bag)
    assert not log.truncated
    assert len(ticks(bag)) + len(log.read_signal("/ugv/tick/slow").values) == len(run)
    assert log.attachments["serve.py"] == SERVE.encode()
    assert said == f"ugv recorder: recording in {bag}\n"
    status = recorder.status
    assert (status.recorded, status.recording, status.bag, status.error) == (len(run), "", bag.parent.name, "")
    assert not (tmp_path / "recorder.sock").exists()


def test_a_recorder_that_comes_back_marks_where_it_goes_on(toy, tmp_path):
    run = fast(toy)
    with service(tmp_path) as first:
        for datagram in islice(run, 100):
            first.send(datagram)
        wait_for(lambda: bool(first.status.recording))
        wait_for(lambda: bool(first.bags()) and first.taken())
        first.end(signal.SIGKILL)
    with service(tmp_path) as second:
        for datagram in islice(run, 50, 150):
            second.send(datagram)
        second.end()
    one, other = second.bags()
    assert Log(one).truncated
    log = Log(other)
    assert log.metadata["beginning"]["previous"] == one.parent.name
    assert log.metadata["first_tick/fast"]["index"] == "150"
    assert ticks(other) == list(range(150, 250))


@settings(max_examples=8)
@given(sent=st.integers(2 * OPEN_CHUNK + 1, 180))
def test_killed_at_any_moment_it_loses_no_more_than_the_open_chunk(toy, tmp_path_factory, sent):
    """Of each burst the test sees the chunk in the file before it goes on, so that it knows what may be lost."""
    directory, run = tmp_path_factory.mktemp("killed"), fast(toy)
    with service(directory) as recorder:
        recorder.send(next(run))
        wait_for(lambda: has_messages(recorder))
        [bag] = recorder.bags()
        size = bag.stat().st_size
        for number, datagram in enumerate(islice(run, sent - 1)):
            if number and number % OPEN_CHUNK == 0:
                size = grown(bag, size)
            recorder.send(datagram)
        recorder.end(signal.SIGKILL)
    [bag] = recorder.bags()
    recovered = Log(recover(Log(bag), directory / "recovered"))
    whole = ticks(recovered.path)
    assert whole == list(range(len(whole)))
    assert len(whole) >= sent - 2 * OPEN_CHUNK
    assert recovered.metadata == Log(bag).metadata
    assert not recovered.truncated


def test_when_a_file_may_not_grow_it_says_so_once_and_goes_on_in_another(toy, tmp_path):
    run = fast(toy)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with service(tmp_path) as recorder:
        resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (60_000, limits[1]))
        wait_for(lambda: sends(recorder, run) and recorder.status.failed > 0)
        assert recorder.status.recording == ""
        assert "file too large" in recorder.status.error
        resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, limits)
        wait_for(lambda: sends(recorder, run) and bool(recorder.status.recording))
        said = recorder.end()
    assert said.count("cannot ") == 1
    assert "file too large" in said
    assert "trying again every second" in said
    bags = recorder.bags()
    assert ticks(bags[0]) == list(range(len(ticks(bags[0]))))
    assert "file too large" in Log(bags[-1]).metadata["beginning"]["reason"]
    assert recorder.status.error, "the last failure stays to be seen"


@pytest.mark.parametrize("gone", ["file", "logs"])
def test_it_notices_that_what_it_writes_is_gone(toy, tmp_path, gone):
    run = fast(toy)
    with service(tmp_path) as recorder:
        sends(recorder, run)
        wait_for(lambda: bool(recorder.bags()))
        [bag] = recorder.bags()
        bag.unlink() if gone == "file" else os.rename(recorder.logs, tmp_path / "away")
        wait_for(lambda: sends(recorder, run) and recorder.status.bags == 2)
        said = recorder.end()
    assert f"{bag} is gone" in said
    assert recorder.bags()[-1] != bag


def test_control_is_not_held_up_by_a_recorder_that_is_stopped(toy, tmp_path):
    run = fast(toy)
    with service(tmp_path) as recorder:
        sends(recorder, run)
        recorder.process.send_signal(signal.SIGSTOP)
        wait_for(lambda: sends(recorder, run) and recorder.stream.dropped > 0)
        recorder.process.send_signal(signal.SIGCONT)
        recorder.end()
        assert recorder.process.returncode == 0
