# SPDX-License-Identifier: Apache-2.0
"""Packets by the batch: their lengths, and what the kernel tells beside them."""

import socket
import struct
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_frame import FRAME_SIZE
from drivers.message_batch import SO_RXQ_OVFL, SO_TIMESTAMPNS, ReceiveBatch, SendBatch, parse_ancillary

CAPACITY = 8
SECOND_NS = 10**9
LATEST_NS = 2**62


def frame(number):
    return bytes([number]) * FRAME_SIZE


def ancillary(level, kind, data):
    """One `struct cmsghdr` with its data."""
    size = socket.CMSG_LEN(len(data))
    return struct.pack("@Nii", size, level, kind) + data.ljust(socket.CMSG_SPACE(len(data)) - socket.CMSG_LEN(0), b"\0")


STAMP = ancillary(socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@qq", 5, 7))
DROPS = ancillary(socket.SOL_SOCKET, SO_RXQ_OVFL, struct.pack("@I", 9))
FOREIGN = ancillary(socket.IPPROTO_IP, SO_TIMESTAMPNS, bytes(16))


@pytest.fixture
def ends():
    """Two ends of a connection that keeps packets apart."""
    pair = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with pair[0], pair[1]:
        yield pair


@pytest.fixture
def datagrams():
    """A socket that stamps and drops what it receives, and one that sends to it."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far,
    ):
        near.bind(("127.0.0.1", 0))
        near.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        near.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        far.connect(near.getsockname())
        yield near, far


# -- reading ----------------------------------------------------------------------------------------------------------


def test_packets_are_read_in_order_and_their_lengths_told(ends):
    near, far = ends
    batch = ReceiveBatch(CAPACITY)
    assert batch.receive(near.fileno(), CAPACITY) == []
    for packet in (frame(1), b"short", frame(2) + b"x", bytes(100), frame(3)):
        far.send(packet)
    assert batch.receive(near.fileno(), CAPACITY) == [16, 5, 17, 32, 16]
    assert [batch.frames[row * FRAME_SIZE : (row + 1) * FRAME_SIZE] for row in (0, 4)] == [frame(1), frame(3)]


def test_no_more_are_read_than_asked_for(ends):
    near, far = ends
    batch = ReceiveBatch(CAPACITY)
    for number in range(5):
        far.send(frame(number))
    assert batch.receive(near.fileno(), 3) == [16] * 3
    assert batch.receive(near.fileno(), CAPACITY) == [16] * 2
    assert batch.frames[:32] == frame(3) + frame(4)


def test_no_more_are_read_than_there_is_room_for(ends):
    near, far = ends
    batch = ReceiveBatch(2)
    for number in range(3):
        far.send(frame(number))
    assert batch.receive(near.fileno(), 1000) == [16] * 2
    assert batch.receive(near.fileno(), 1000) == [16]


def test_a_far_end_that_closed_gives_packets_of_no_length(ends):
    near, far = ends
    far.send(frame(1))
    far.close()
    assert ReceiveBatch(CAPACITY).receive(near.fileno(), CAPACITY) == [16] + [0] * 7


def test_a_socket_that_failed_is_told(ends):
    near, far = ends
    near.send(frame(1))
    far.close()  # with something unread
    with pytest.raises(ConnectionResetError):
        ReceiveBatch(CAPACITY).receive(near.fileno(), CAPACITY)


# -- what is told beside a packet -------------------------------------------------------------------------------------


def test_without_a_stamp_a_packet_arrives_when_it_is_read(ends):
    near, far = ends
    batch = ReceiveBatch(CAPACITY)
    far.send(frame(1))
    batch.receive(near.fileno(), CAPACITY)
    assert batch.arrivals(1, 0, 0, 77) == ([77], 0)


def test_stamps_are_the_kernels_and_stay_within_their_bounds(datagrams):
    near, far = datagrams
    batch = ReceiveBatch(CAPACITY)
    begin_ns = time.time_ns()
    for number in range(3):
        far.send(frame(number))
    batch.receive(near.fileno(), CAPACITY)
    stamps_ns, dropped = batch.arrivals(3, 0, 0, LATEST_NS)
    assert begin_ns - SECOND_NS < min(stamps_ns) < time.time_ns() + SECOND_NS
    assert (stamps_ns, dropped) == (sorted(stamps_ns), 0)
    assert batch.arrivals(3, 1000, 0, LATEST_NS)[0] == [each - 1000 for each in stamps_ns]
    assert batch.arrivals(3, 0, stamps_ns[1], stamps_ns[1])[0] == [stamps_ns[1]] * 3


def test_a_stamp_is_not_taken_for_that_of_a_later_packet(datagrams):
    near, far = datagrams
    batch = ReceiveBatch(CAPACITY)
    far.send(frame(1))
    batch.receive(near.fileno(), CAPACITY)
    near.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 0)
    far.send(frame(2))
    batch.receive(near.fileno(), CAPACITY)
    assert batch.arrivals(1, 0, 0, LATEST_NS) == ([LATEST_NS], 0)


def test_what_a_socket_dropped_is_told_by_the_next_packet(datagrams):
    near, far = datagrams
    batch = ReceiveBatch(CAPACITY)
    near.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    sent, read = 1000, 0
    for _ in range(sent):
        far.send(frame(1))
    while lengths := batch.receive(near.fileno(), CAPACITY):
        read += len(lengths)
    assert read < sent
    far.send(frame(2))
    assert batch.receive(near.fileno(), CAPACITY) == [16]
    stamps_ns, dropped = batch.arrivals(1, 0, 0, LATEST_NS)
    assert dropped == sent - read
    assert abs(time.time_ns() - stamps_ns[0]) < 100 * SECOND_NS


def test_stamps_are_found_among_other_things_told(datagrams):
    near, far = datagrams
    near.setsockopt(socket.IPPROTO_IP, socket.IP_RECVTOS, 1)
    batch = ReceiveBatch(CAPACITY)
    far.send(frame(1))
    batch.receive(near.fileno(), CAPACITY)
    stamps_ns, dropped = batch.arrivals(1, 0, 0, LATEST_NS)
    assert abs(time.time_ns() - stamps_ns[0]) < 100 * SECOND_NS
    assert dropped == 0


@pytest.mark.parametrize(
    ("control", "told"),
    [
        (b"", (None, 0)),
        (bytes(56), (None, 0)),
        (STAMP, (5 * SECOND_NS + 7, 0)),
        (DROPS, (None, 9)),
        (DROPS + STAMP, (5 * SECOND_NS + 7, 9)),
        (FOREIGN + STAMP + FOREIGN + DROPS, (5 * SECOND_NS + 7, 9)),
        (STAMP[:-1], (None, 0)),
    ],
)
def test_what_is_told_may_come_in_any_order(control, told):
    assert parse_ancillary(control) == told


@given(st.lists(st.one_of(st.sampled_from([STAMP, DROPS, FOREIGN]), st.binary(max_size=60))))
def test_whatever_is_told_is_read_to_an_end(parts):
    stamp_ns, dropped = parse_ancillary(b"".join(parts))
    assert stamp_ns is None or isinstance(stamp_ns, int)
    assert 0 <= dropped < 2**32


# -- sending ----------------------------------------------------------------------------------------------------------


def test_frames_are_sent_one_a_packet_as_far_as_the_capacity_goes(ends):
    near, far = ends
    batch = SendBatch(2)
    assert batch.send(near.fileno(), frame(1) + frame(2) + frame(3)) == 2
    assert batch.send(near.fileno(), frame(4)) == 1
    assert [far.recv(100) for _ in range(3)] == [frame(1), frame(2), frame(4)]


def test_sending_stops_at_the_first_that_finds_no_room(ends):
    near, far = ends
    near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    batch = SendBatch(64)
    sent = batch.send(near.fileno(), b"".join(frame(number) for number in range(64)))
    assert 0 < sent < 64
    with pytest.raises(BlockingIOError):
        batch.send(near.fileno(), frame(99))
    assert [far.recv(100) for _ in range(sent)] == [frame(number) for number in range(sent)]


def test_a_far_end_that_is_gone_is_told_without_a_signal(ends):
    near, far = ends
    far.close()
    with pytest.raises(BrokenPipeError):
        SendBatch(2).send(near.fileno(), frame(1))
