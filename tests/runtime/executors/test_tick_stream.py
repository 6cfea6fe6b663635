# SPDX-License-Identifier: Apache-2.0
"""Ticks reach a listener in another process, in order; its absence and its end are counted."""

import os
import signal
import socket
import subprocess
import sys
import threading

import pytest

from runtime.executors.tick_stream import TickListener, TickStream, TickStreamError, TickStreams

TIMEOUT_S = 20.0
FIRST_MOMENTS = 100


@pytest.fixture
def path(tmp_path):
    return tmp_path / "ticks.sock"


def everything(listener):
    received = []
    while (datagram := listener.receive(0.0)) is not None:
        received.append(datagram)
    return received


def test_datagrams_of_any_size_arrive_whole_and_in_order(path):
    listener, stream = TickListener(path), TickStream(path)
    sent = [bytes([i]) * size for i, size in enumerate((1, 16, 4096, 65000))]
    for datagram in sent:
        stream.write(datagram)
    assert everything(listener) == sent
    assert stream.dropped == 0
    stream.close()
    listener.close()
    assert not path.exists()


def test_several_streams_take_turns(path):
    listener = TickListener(path)
    streams = [TickStream(path) for _ in range(3)]
    for i in range(5):
        for number, stream in enumerate(streams):
            stream.write(b"%d %d" % (number, i))
    received = everything(listener)
    assert listener.streams == 3
    for number in range(3):
        assert [one for one in received if one.startswith(b"%d " % number)] == [
            b"%d %d" % (number, i) for i in range(5)
        ]
    for stream in streams:
        stream.close()
    assert everything(listener) == []
    assert listener.streams == 0
    listener.close()


def test_threads_that_write_first_at_the_same_moment_lose_nothing(path):
    listener = TickListener(path)
    for _ in range(FIRST_MOMENTS):
        stream, moment = TickStream(path), threading.Barrier(2)

        def write(datagram, stream=stream, moment=moment):
            moment.wait(TIMEOUT_S)
            stream.write(datagram)

        threads = [threading.Thread(target=write, args=(datagram,)) for datagram in (b"one", b"two")]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert stream.dropped == 0
        assert sorted(everything(listener)) == [b"one", b"two"]
        stream.close()
    listener.close()


def test_a_stream_is_connected_before_it_is_first_written_to(path):
    listener = TickListener(path)
    stream = TickStream(path)
    assert listener.receive(0.0) is None
    assert listener.streams == 1
    stream.close()
    listener.close()


def test_a_listener_that_came_before_the_first_datagram_is_found_at_once(path):
    stream = TickStream(path)
    listener = TickListener(path)
    stream.write(b"tick")
    assert everything(listener) == [b"tick"]
    stream.close()
    listener.close()


def test_without_a_listener_datagrams_are_counted(path):
    stream = TickStream(path)
    for _ in range(3):
        stream.write(b"tick")
    assert stream.dropped == 3


def test_a_listener_that_does_not_read_costs_datagrams_but_no_wait(path):
    listener, stream = TickListener(path), TickStream(path)
    written = 0
    while not stream.dropped:
        stream.write(bytes(60_000))
        written += 1
    assert len(everything(listener)) == written - 1
    stream.write(b"again")
    assert everything(listener) == [b"again"]
    listener.close()


def test_a_stream_finds_the_listener_that_came_back(path, monkeypatch):
    now_ns = 10**12
    monkeypatch.setattr("time.monotonic_ns", lambda: now_ns)
    listener, stream = TickListener(path), TickStream(path)
    stream.write(b"before")
    assert everything(listener) == [b"before"]
    listener.close()
    stream.write(b"lost")
    stream.write(b"lost too")
    assert stream.dropped == 2
    listener = TickListener(path)
    now_ns += 10**9
    stream.write(b"after")
    assert everything(listener) == [b"after"]
    listener.close()


def test_the_file_of_a_killed_listener_is_taken_over(path):
    code = "from pathlib import Path; from runtime.executors.tick_stream import TickListener\n"
    code += f"listener = TickListener(Path({str(path)!r})); print('up', flush=True); listener.receive(100.0)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=dict(os.environ)) as process:
        assert process.stdout.readline() == b"up\n"
        with pytest.raises(TickStreamError, match="another process listens there"):
            TickListener(path)
        process.send_signal(signal.SIGKILL)
    assert path.exists()
    listener = TickListener(path)
    listener.close()


def test_what_is_no_socket_file_is_refused(tmp_path):
    with pytest.raises(TickStreamError, match="cannot listen there"):
        TickListener(tmp_path / "there" / "is none")


def test_of_several_streams_the_drops_of_the_first_are_told(tmp_path):
    listener = TickListener(tmp_path / "second")
    both = TickStreams(TickStream(tmp_path / "first"), TickStream(tmp_path / "second"))
    both.write(b"tick")
    assert both.dropped == 1
    assert everything(listener) == [b"tick"]
    listener.close()


def test_a_probe_that_says_nothing_is_let_go(path):
    listener = TickListener(path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        probe.connect(str(path))
        assert listener.receive(0.0) is None
    assert listener.receive(0.0) is None
    assert listener.streams == 0
    listener.close()
