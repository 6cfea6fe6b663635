# SPDX-License-Identifier: Apache-2.0
"""Ports on real descriptors: whole frames in order, bounded work, and every loss counted at its bus."""

import socket

import numpy as np
import pytest

from drivers.can_frame import CAN_FRAME, FRAME_SIZE, make_frames
from drivers.errors import FrameError
from drivers.socket_ports import BusCounter, SocketReader, SocketWriter, open_ends
from drivers.unix_can import UnixCanBus
from drivers.unix_hub import UnixHub

BUSES, CAPACITY = 2, 16


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
        self.buses = [UnixCanBus(str(hub.path)) for hub in self.hubs]
        for hub in self.hubs:
            hub.receive()
        ends = open_ends([bus.fileno() for bus in self.buses])
        self.reader, self.writer = SocketReader(ends), SocketWriter(ends)

    def close(self):
        for end in (*self.buses, *self.hubs):
            end.shutdown() if isinstance(end, UnixCanBus) else end.close()


@pytest.fixture
def wires(tmp_path):
    made = Wires(tmp_path)
    yield made
    made.close()


def test_frames_go_out_on_their_buses_in_order(wires):
    batch = Batch()
    batch.hold((0, 1), (1, 2), (0, 3), (1, 4))
    wires.writer.write(batch, 5)
    sent = [np.frombuffer(hub.receive(), CAN_FRAME)["can_id"].tolist() for hub in wires.hubs]
    assert sent == [[1, 3], [2, 4]]
    assert not wires.writer.counters.any()


def test_what_arrives_is_read_and_what_was_there_before_is_gone(wires):
    batch = Batch()
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


def test_a_flooded_bus_leaves_the_other_its_share(wires):
    wires.hubs[0].send(make_frames(range(100), 8).tobytes())
    wires.hubs[1].send(make_frames([500], 8).tobytes())
    batch = Batch()
    wires.reader.read(batch, 1)
    assert batch.content() == [*((0, number) for number in range(8)), (1, 500)]
    wires.reader.read(batch, 2)
    assert batch.content() == [(0, number) for number in range(8, 16)]


def test_a_bus_that_takes_nothing_refuses_soon_and_is_counted_alone(wires):
    batch = Batch()
    batch.hold((0, 1), (1, 1))
    for _ in range(400):
        wires.writer.write(batch, 1)
        wires.hubs[1].receive()
    refused = wires.writer.counters[BusCounter.REFUSED]
    waiting = len(wires.hubs[0].receive()) // FRAME_SIZE
    assert refused.tolist() == [400 - waiting, 0]
    assert waiting < 50


def test_a_bus_that_goes_down_is_counted_and_the_other_goes_on(wires):
    wires.hubs[0].close()
    batch = Batch()
    batch.hold((0, 1), (1, 2))
    wires.writer.write(batch, 1)
    assert wires.writer.counters[BusCounter.FAILED].tolist() == [1, 0]
    wires.hubs[1].send(make_frames([3], 8).tobytes())
    assert wires.reader.read(batch, 2)
    assert batch.content() == [(1, 3)]
    assert wires.reader.counters[BusCounter.FAILED].tolist() == [1, 0]


def test_a_packet_that_is_no_frame_is_counted():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        reader, batch = SocketReader(open_ends([ours.fileno()])), Batch()
        theirs.send(b"short")
        theirs.send(make_frames([4], 8).tobytes())
        assert reader.read(batch, 1)
        assert batch.content() == [(0, 4)]
        assert reader.counters[BusCounter.NO_FRAME].tolist() == [1]


def test_a_batch_that_contradicts_itself_is_refused(wires):
    batch = Batch()
    batch.hold((2, 1))
    with pytest.raises(FrameError, match="there is no bus 2: 2 buses are open"):
        wires.writer.write(batch, 1)
    batch.count = CAPACITY + 1
    with pytest.raises(FrameError, match="claims to hold 17"):
        wires.writer.write(batch, 1)
