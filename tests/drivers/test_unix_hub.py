# SPDX-License-Identifier: Apache-2.0
"""A hub carries every frame to everybody else, in order, whatever single ends do; python-can's tools speak to it."""

import socket

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import unix_hub
from drivers.can_frame import CAN_EFF_MASK, CAN_FRAME, make_frames
from drivers.errors import DriverConfigError
from drivers.unix_can import UnixCanBus, pack, unpack
from drivers.unix_hub import UnixHub

DATA = st.binary(max_size=8)
STANDARD = st.builds(
    lambda i, d: can.Message(arbitration_id=i, data=d, is_extended_id=False), st.integers(0, 0x7FF), DATA
)
EXTENDED = st.builds(lambda i, d: can.Message(arbitration_id=i, data=d), st.integers(0, 0x1FFFFFFF), DATA)
REMOTE = st.builds(
    lambda i, n: can.Message(arbitration_id=i, dlc=n, is_remote_frame=True, is_extended_id=False),
    st.integers(0, 0x7FF),
    st.integers(0, 8),
)
ERROR = st.builds(
    lambda i, d: can.Message(arbitration_id=i, data=d, is_error_frame=True, is_extended_id=False),
    st.integers(0, 0x1FF),
    st.binary(min_size=8, max_size=8),
)


@pytest.fixture
def hub(tmp_path):
    made = UnixHub(tmp_path / "can0")
    yield made
    made.close()


@pytest.fixture
def join(hub):
    """Makes ends of the bus."""
    ends = []

    def make():
        end = UnixCanBus(str(hub.path))
        ends.append(end)
        hub.receive()
        return end

    yield make
    for end in ends:
        end.shutdown()


def received(end):
    """All that has arrived at an end."""
    messages = []
    while (message := end.recv(0.0)) is not None:
        messages.append(message)
    return messages


@given(st.one_of(STANDARD, EXTENDED, REMOTE, ERROR))
def test_a_message_is_itself_again(message):
    again = unpack(pack(message), message.timestamp, "somewhere")
    assert again.equals(message, check_channel=False)
    assert pack(again) == pack(message)


def test_a_message_is_the_kernels_struct_can_frame():
    message = can.Message(arbitration_id=0x123, data=bytes(range(8)), is_extended_id=False)
    assert pack(message).hex() == "230100000800000000010203040506" + "07"
    frame = make_frames([0x123], 8, bytes(range(8)))
    assert pack(message) == frame.tobytes()
    assert len(pack(message)) == CAN_FRAME.itemsize


def test_everybody_else_receives_in_order(hub, join):
    one, two, three = join(), join(), join()
    sent = [can.Message(arbitration_id=number, data=[number], is_extended_id=False) for number in range(20)]
    for message in sent:
        one.send(message)
    raw = hub.receive()
    assert raw == b"".join(map(pack, sent))
    assert received(one) == []
    for end in (two, three):
        assert [message.arbitration_id for message in received(end)] == list(range(20))
    hub.send(raw[:32])
    assert [[message.arbitration_id for message in received(end)] for end in (one, two, three)] == [[0, 1]] * 3


def test_python_can_finds_it_by_name(hub):
    with can.Bus(interface="ugv-unix", channel=str(hub.path)) as bus:
        hub.receive()
        hub.send(make_frames([0x55], 2, b"ok").tobytes())
        message = bus.recv(1.0)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x55, b"ok")


def test_filters_are_python_cans(hub):
    with UnixCanBus(str(hub.path), can_filters=[{"can_id": 2, "can_mask": 0x7FF, "extended": False}]) as bus:
        hub.receive()
        hub.send(make_frames([1, 2, 3], 0).tobytes())
        message = bus.recv(1.0)
        assert message is not None
        assert message.arbitration_id == 2


def test_an_end_that_does_not_read_costs_its_own_frames_alone(hub, join):
    lazy, busy = join(), join()
    frame, got = make_frames([7], 8).tobytes(), 0
    for _ in range(5000):
        hub.send(frame)
        got += len(received(busy))
    assert got == 5000
    assert hub.dropped > 0
    assert len(received(lazy)) == 5000 - hub.dropped


def test_an_end_that_floods_leaves_its_owner_time_for_others(hub, join, monkeypatch):
    monkeypatch.setattr(unix_hub, "_MOST_PACKETS", 5)
    one, two = join(), join()
    for number in range(12):
        one.send(can.Message(arbitration_id=number))
    two.send(can.Message(arbitration_id=99))
    heard = [np.frombuffer(hub.receive(), CAN_FRAME)["can_id"] & CAN_EFF_MASK for _ in range(4)]
    assert [each.tolist() for each in heard] == [[0, 1, 2, 3, 4, 99], [5, 6, 7, 8, 9], [10, 11], []]


def test_an_end_that_leaves_is_forgotten(hub, join):
    one, two = join(), join()
    two.shutdown()
    for _ in range(3):
        one.send(can.Message(arbitration_id=1))
        assert len(hub.receive()) == 16
    hub.send(make_frames([9], 0).tobytes())
    assert [message.arbitration_id for message in received(one)] == [9]


@pytest.mark.parametrize("packet", [b"x", bytes(15), bytes(17), bytes(72)])
def test_a_packet_that_is_no_frame_is_counted_and_goes_no_further(hub, join, packet):
    listener = join()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as rude:
        rude.connect(str(hub.path))
        rude.send(packet)
        assert hub.receive() == b""
    assert hub.rejected == 1
    assert received(listener) == []


def test_when_the_hub_goes_its_ends_are_told(tmp_path):
    hub = UnixHub(tmp_path / "can0")
    with UnixCanBus(str(hub.path)) as end:
        hub.receive()
        hub.close()
        with pytest.raises(can.CanOperationError, match="is gone"):
            end.recv(1.0)
        with pytest.raises(can.CanOperationError, match="is gone"):
            end.send(can.Message(arbitration_id=1))


def test_without_a_hub_there_is_no_bus(tmp_path):
    with pytest.raises(can.CanInitializationError, match="no CAN hub at"):
        UnixCanBus(str(tmp_path / "nothing"))


def test_one_hub_a_bus_but_a_dead_ones_place_is_taken(tmp_path):
    path = tmp_path / "can0"
    hub = UnixHub(path)
    with pytest.raises(DriverConfigError, match="another process listens there"):
        UnixHub(path)
    hub._listener.close()
    UnixHub(path).close()
    assert not path.exists()
    with pytest.raises(DriverConfigError, match="no CAN hub can be made there"):
        UnixHub(tmp_path / "nowhere" / "can0")


def test_fd_is_refused():
    with pytest.raises(can.CanOperationError, match="classic CAN only"):
        pack(can.Message(arbitration_id=1, data=bytes(12), is_fd=True))
