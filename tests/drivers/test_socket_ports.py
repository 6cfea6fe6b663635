# SPDX-License-Identifier: Apache-2.0
"""Ports on real sockets: whole frames in order, bounded work, every loss counted at its bus, and links that return."""

import socket
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import bus_socket
from drivers.bus_health import BusState
from drivers.bus_socket import MOST_AT_ONCE, RETRY_NS, BusSocket, open_buses
from drivers.can_frame import CAN_ERR_FLAG, CAN_FRAME, FRAME_SIZE, make_frames
from drivers.errors import FrameError
from drivers.message_batch import SO_TIMESTAMPNS
from drivers.opening import UNIX
from drivers.socket_ports import SocketReader, SocketWriter
from drivers.unix_hub import UnixHub

BUSES, CAPACITY = 2, 16
BUS_OFF = CAN_ERR_FLAG | 0x40
SECOND_NS = 10**9
NEVER_S = 1000.0


class Batch:
    """A batch of frames, as a loop's record holds it."""

    def __init__(self):
        self.stamp_ns = self.count = self.lost = 0
        self.bus, self.arrival_ns = np.zeros(CAPACITY, np.uint8), np.zeros(CAPACITY, np.int64)
        self.data = np.zeros(CAPACITY * FRAME_SIZE, np.uint8)

    def hold(self, *frames):
        """Put (bus, identifier) into it."""
        self.count = len(frames)
        self.bus[: self.count] = [bus for bus, _ in frames]
        made = make_frames([identifier for _, identifier in frames], 8)
        self.data[: self.count * FRAME_SIZE] = np.frombuffer(made.tobytes(), np.uint8)

    def content(self):
        frames = self.data.view(CAN_FRAME)[: self.count]
        return list(zip(self.bus[: self.count].tolist(), frames["can_id"].tolist(), strict=True))


class Wires:
    """Two buses with their hubs at the far end."""

    def __init__(self, directory):
        self.hubs = [UnixHub(directory / f"can{bus}") for bus in range(BUSES)]
        self.buses = open_buses(UNIX, [str(hub.path) for hub in self.hubs])
        for hub in self.hubs:
            hub.receive()
        self.reader, self.writer = SocketReader(self.buses), SocketWriter(self.buses)
        self.batch = Batch()

    def health(self, name):
        return [getattr(bus.health, name) for bus in self.buses]

    def read(self, now_ns):
        self.reader.read(self.batch, now_ns)
        return self.batch.content()

    def send(self, *frames, now_ns=1):
        batch = Batch()
        batch.hold(*frames)
        self.writer.write(batch, now_ns)

    def reopen(self, bus):
        """Bring a hub back, as a simulator does that is started again."""
        self.hubs[bus] = UnixHub(self.hubs[bus].path)

    def close(self):
        for end in (*self.buses, *self.hubs):
            end.close()


@pytest.fixture
def wires(tmp_path):
    made = Wires(tmp_path)
    yield made
    made.close()


class Plain:
    """A bus whose far end takes any packet, as python-can gives it."""

    def __init__(self, end):
        self._end = end

    def fileno(self):
        return self._end.fileno()

    def shutdown(self):
        self._end.close()


@pytest.fixture
def plain(monkeypatch):
    """A bus and its far end."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setblocking(False)
    with monkeypatch.context() as patch:
        patch.setattr(bus_socket, "open_bus", lambda interface, channel: Plain(ours))
        bus = BusSocket(UNIX, "anything")
    yield bus, theirs
    bus.close()
    theirs.close()


# -- carrying ---------------------------------------------------------------------------------------------------------


def test_frames_go_out_on_their_buses_in_order(wires):
    wires.send((0, 1), (1, 2), (0, 3), (1, 4))
    sent = [np.frombuffer(hub.receive(), CAN_FRAME)["can_id"].tolist() for hub in wires.hubs]
    assert sent == [[1, 3], [2, 4]]
    assert wires.health("refused") == wires.health("failed") == [0, 0]


def test_what_arrives_is_read_and_what_was_there_before_is_gone(wires):
    batch = wires.batch
    assert not wires.reader.read(batch, 10)
    wires.hubs[1].send(make_frames([7, 8], 8).tobytes())
    wires.hubs[0].send(make_frames([9], 8).tobytes())
    assert wires.reader.read(batch, 20)
    assert batch.content() == [(0, 9), (1, 7), (1, 8)]
    assert (batch.stamp_ns, batch.arrival_ns[:4].tolist()) == (20, [20, 20, 20, 0])
    assert wires.reader.read(batch, 30)
    assert (batch.stamp_ns, batch.count) == (30, 0)
    assert not batch.data.any()
    assert not wires.reader.read(batch, 40)
    assert batch.stamp_ns == 30


def test_a_batch_that_contradicts_itself_is_refused(wires):
    batch = Batch()
    batch.hold((2, 1))
    with pytest.raises(FrameError, match="there is no bus 2: 2 buses are open"):
        wires.writer.write(batch, 1)
    batch.count = CAPACITY + 1
    with pytest.raises(FrameError, match="claims to hold 17"):
        wires.writer.write(batch, 1)


def test_frames_go_out_in_order_whatever_the_last_batch_was(wires):
    for frames in ([(0, 1), (0, 2), (1, 3)], [(1, 4), (0, 5)], [], [(1, 6), (0, 7)]):
        wires.send(*frames)
        sent = [np.frombuffer(hub.receive(), CAN_FRAME)["can_id"].tolist() for hub in wires.hubs]
        assert sent == [[identifier for to, identifier in frames if to == bus] for bus in range(BUSES)]


class Rival:
    """A thread that counts whenever it is let run: with so long a switch interval, when another thread waits.

    `time.sleep(0)` passes no time: it gives the interpreter up.
    """

    def __enter__(self):
        self._interval_s, self._stop, self.counted = sys.getswitchinterval(), False, 0
        sys.setswitchinterval(NEVER_S)
        self._runs = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        self._runs.wait()
        return self

    def _run(self):
        while not self._stop:
            self.counted += 1
            self._runs.set()
            time.sleep(0)

    def __exit__(self, *_):
        self._stop = True
        sys.setswitchinterval(self._interval_s)
        self._thread.join()


def test_a_tick_on_the_buses_lets_no_other_thread_run(wires):
    batch, read, counted = Batch(), 0, 0
    batch.hold((0, 1), (0, 2), (1, 3))
    with Rival() as rival:
        for tick in range(300):
            wires.hubs[0].send(make_frames([7, 8], 8).tobytes())
            before = rival.counted
            wires.reader.read(wires.batch, tick)
            wires.writer.write(batch, tick)
            counted += rival.counted - before
            read += wires.batch.count
            wires.hubs[0].receive()
            wires.hubs[1].receive()
        before = rival.counted
        while rival.counted == before:  # it was there all the time
            time.sleep(0)
    assert (read, counted) == (600, 0)


# -- too much ---------------------------------------------------------------------------------------------------------


def test_a_flooded_bus_leaves_the_other_its_share_and_is_told(wires):
    wires.hubs[0].send(make_frames(range(17), 8).tobytes())
    wires.hubs[1].send(make_frames([500], 8).tobytes())
    assert wires.read(1) == [*((0, number) for number in range(8)), (1, 500)]
    assert wires.health("backlog") == [True, False]
    assert wires.read(2) == [(0, number) for number in range(8, 16)]
    assert wires.health("backlog") == [True, False]
    assert wires.read(3) == [(0, 16)]
    assert wires.health("backlog") == [False, False]


def test_a_share_that_is_just_used_up_is_no_flood(wires):
    wires.hubs[0].send(make_frames(range(8), 8).tobytes())
    assert len(wires.read(1)) == 8
    assert wires.health("backlog") == [False, False]


def test_a_bus_that_takes_nothing_refuses_soon_and_is_counted_alone(wires):
    for _ in range(400):
        wires.send((0, 1), (1, 1))
        wires.hubs[1].receive()
    waiting = len(wires.hubs[0].receive()) // FRAME_SIZE
    assert wires.health("refused") == [400 - waiting, 0]
    assert wires.health("state") == [BusState.UP] * 2
    assert waiting < 50


def test_of_many_frames_those_without_room_are_refused_one_by_one(plain):
    bus, theirs = plain
    many = make_frames(range(400), 8).tobytes()
    bus.send(many, 1)
    waiting = []
    with pytest.raises(BlockingIOError):
        while True:
            waiting.append(theirs.recv(FRAME_SIZE))
    assert b"".join(waiting) == many[: len(waiting) * FRAME_SIZE]
    assert 0 < bus.health.refused == 400 - len(waiting)
    assert bus.health.state == BusState.UP


def test_more_frames_than_one_call_carries_are_sent_and_read(plain):
    bus, theirs = plain
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    many = make_frames(range(MOST_AT_ONCE + 3), 8).tobytes()
    for begin in range(0, len(many), FRAME_SIZE):
        theirs.send(many[begin : begin + FRAME_SIZE])
    frames, arrival_ns = bus.receive(1000, 1)
    assert (frames, arrival_ns) == (many[: MOST_AT_ONCE * FRAME_SIZE], [1] * MOST_AT_ONCE)
    assert bus.health.backlog
    assert bus.receive(1000, 2) == (many[MOST_AT_ONCE * FRAME_SIZE :], [2, 2, 2])
    assert not bus.health.backlog


# -- links ------------------------------------------------------------------------------------------------------------


def test_a_bus_that_goes_down_is_counted_and_the_other_goes_on(wires):
    wires.hubs[0].close()
    wires.send((0, 1), (1, 2), (0, 3))
    assert wires.health("failed") == [2, 0]
    assert wires.health("state") == [BusState.DOWN, BusState.UP]
    wires.hubs[1].send(make_frames([3], 8).tobytes())
    assert wires.read(2) == [(1, 3)]
    assert wires.health("failed") == [2, 0]


def test_all_frames_for_a_bus_that_goes_down_are_counted(wires):
    wires.hubs[0].close()
    wires.send((0, 1), (0, 2), (0, 3), (1, 4))
    assert wires.health("failed") == [3, 0]


def test_what_came_before_the_far_end_closed_is_read(plain):
    bus, theirs = plain
    frames = make_frames(range(3), 8).tobytes()
    for begin in range(0, len(frames), FRAME_SIZE):
        theirs.send(frames[begin : begin + FRAME_SIZE])
    theirs.close()
    assert bus.receive(3, 1)[0] == frames
    assert (bus.health.state, bus.health.backlog) == (BusState.UP, False)
    assert bus.receive(3, 2) == (b"", [])
    assert (bus.health.state, bus.health.failed, bus.health.malformed) == (BusState.DOWN, 1, 0)


def test_reading_finds_the_loss_of_a_bus_as_well(wires):
    wires.hubs[1].close()
    assert wires.read(1) == []
    assert wires.health("state") == [BusState.UP, BusState.DOWN]
    assert wires.health("failed") == [0, 1]


def test_a_bus_that_returns_is_found_within_the_period_of_the_search(wires):
    wires.hubs[0].close()
    wires.read(1)
    wires.read(1 + RETRY_NS)
    assert wires.health("state")[0] == BusState.DOWN
    wires.reopen(0)
    wires.read(2 * RETRY_NS)
    assert wires.health("state")[0] == BusState.DOWN, "looked for before its turn"
    wires.read(1 + 2 * RETRY_NS)
    assert wires.health("state")[0] == BusState.UP
    wires.send((0, 5))
    assert np.frombuffer(wires.hubs[0].receive(), CAN_FRAME)["can_id"].tolist() == [5]
    wires.hubs[0].send(make_frames([6], 8).tobytes())
    assert wires.read(2 + 2 * RETRY_NS) == [(0, 6)]


def test_what_waited_when_the_bus_was_lost_is_purged(wires):
    wires.hubs[0].send(make_frames(range(5), 8).tobytes())
    wires.hubs[0].close()
    wires.send((0, 1))
    wires.reopen(0)
    assert wires.read(1 + RETRY_NS) == []
    assert wires.health("purged") == [5, 0]
    assert wires.read(2 + RETRY_NS) == []


def test_a_bus_lost_time_and_again_leaves_nothing_open(wires, tmp_path):
    def descriptors():
        return sum(1 for _ in (tmp_path / "fd").iterdir())

    (tmp_path / "fd").symlink_to("/proc/self/fd")
    before = descriptors()
    for attempt in range(1, 20):
        wires.hubs[0].close()
        wires.read(2 * attempt * RETRY_NS)
        wires.reopen(0)
        wires.read((2 * attempt + 1) * RETRY_NS)
        wires.hubs[0].receive()
        assert wires.health("state")[0] == BusState.UP
    assert descriptors() == before


def test_nothing_is_sent_on_a_bus_that_is_off_until_it_restarts(wires):
    wires.hubs[0].send(make_frames([BUS_OFF], 8).tobytes())
    assert wires.read(1) == [(0, BUS_OFF)]
    assert wires.health("state") == [BusState.OFF, BusState.UP]
    wires.send((0, 1), (1, 1))
    assert wires.hubs[0].receive() == b""
    assert wires.health("failed") == [1, 0]
    wires.hubs[0].send(make_frames([CAN_ERR_FLAG | 0x100], 8).tobytes())
    wires.read(2)
    assert wires.health("state") == [BusState.UP, BusState.UP]
    wires.send((0, 2))
    assert len(wires.hubs[0].receive()) == FRAME_SIZE


# -- packets ----------------------------------------------------------------------------------------------------------


def test_a_packet_that_is_no_frame_is_counted(plain):
    bus, theirs = plain
    theirs.send(b"short")
    theirs.send(make_frames([4], 8).tobytes())
    assert bus.receive(8, 1) == (make_frames([4], 8).tobytes(), [1])
    assert bus.health.malformed == 1


@settings(max_examples=200)
@given(st.lists(st.binary(min_size=1, max_size=80), max_size=30), st.integers(1, 12))
def test_whatever_comes_is_a_frame_or_counted_and_reading_ends(packets, most):
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with pytest.MonkeyPatch.context() as patch, theirs:
        patch.setattr(bus_socket, "open_bus", lambda interface, channel: Plain(ours))
        bus = BusSocket(UNIX, "anything")
        for packet in packets:
            theirs.send(packet)
        got, left = [], len(packets)
        reader, batch = SocketReader([bus]), Batch()
        for now_ns in range(1, 40):
            reader.read(batch, now_ns)
            got.append(batch.data[: batch.count * FRAME_SIZE].tobytes())
            frames, _ = bus.receive(most, now_ns)
            got.append(frames)
            left = max(0, left - CAPACITY - most)
            assert bus.health.backlog == (left > 0)
        bus.close()
    whole = [packet for packet in packets if len(packet) == FRAME_SIZE]
    assert b"".join(got) == b"".join(whole)
    assert bus.health.malformed == len(packets) - len(whole)


def test_a_packet_of_no_length_is_no_end_of_the_bus(plain):
    bus, theirs = plain
    theirs.send(b"")
    theirs.send(make_frames([4], 8).tobytes())
    assert bus.receive(8, 1)[0] == make_frames([4], 8).tobytes()
    assert (bus.health.malformed, bus.health.state) == (1, BusState.UP)


# -- time -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def stamped(plain):
    """A bus whose kernel stamps, and its far end."""
    bus, theirs = plain
    bus._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    return bus, theirs


def test_a_frame_is_stamped_when_the_kernel_got_it(stamped):
    bus, theirs = stamped
    begin_ns = time.monotonic_ns()
    theirs.send(make_frames([1], 8).tobytes())
    _, (arrival_ns,) = bus.receive(8, begin_ns + 1000 * SECOND_NS)
    assert abs(arrival_ns - begin_ns) < 500 * SECOND_NS


@pytest.mark.parametrize(("step_s", "where"), [(-3600, "at the present"), (3600, "at the last read")])
def test_a_clock_that_is_set_meanwhile_moves_a_stamp_no_further_than_the_reads(step_s, where, stamped, monkeypatch):
    bus, theirs = stamped
    last_ns = time.monotonic_ns()
    bus.receive(8, last_ns)
    theirs.send(make_frames([1], 8).tobytes())
    clock = SimpleNamespace(monotonic_ns=time.monotonic_ns, time_ns=lambda: time.time_ns() + step_s * SECOND_NS)
    monkeypatch.setattr(bus_socket, "time", clock)
    now_ns = time.monotonic_ns()
    assert bus.receive(8, now_ns)[1] == [now_ns if where == "at the present" else last_ns]
