# SPDX-License-Identifier: Apache-2.0
"""The drives' end of real buses is to a world what the buses in memory are."""

import numpy as np
import pytest

from drivers.can_frame import CAN_FRAME, make_frames
from drivers.device_end import CanWire, DeviceEnd, open_device_end
from drivers.errors import DriverConfigError
from drivers.memory_bus import End
from drivers.opening import UNIX, open_bus
from drivers.unix_can import UnixCanBus


class Rig:
    """Two hubs and a listener on each."""

    def __init__(self, directory):
        self.channels = [str(directory / f"can{bus}") for bus in range(2)]
        self.far = open_device_end(UNIX, self.channels)
        self.near = [open_bus(UNIX, channel) for channel in self.channels]
        self.wires = [CanWire(bus) for bus in self.near]
        self.far.receive(End.DEVICE, 0)

    def close(self):
        for wire in self.wires:
            wire.close()
        self.far.close()


@pytest.fixture
def rig(tmp_path):
    made = Rig(tmp_path)
    yield made
    made.close()


def test_what_the_controller_sends_arrives_with_its_bus(rig):
    rig.wires[1].send(make_frames([1, 2], 8).tobytes())
    rig.wires[0].send(make_frames([3], 8).tobytes())
    frames, bus, arrival_ns = rig.far.receive(End.DEVICE, 77)
    assert (frames["can_id"].tolist(), bus.tolist(), arrival_ns.tolist()) == ([3, 1, 2], [0, 1, 1], [77] * 3)
    frames, bus, arrival_ns = rig.far.receive(End.DEVICE, 78)
    assert (frames.size, bus.size, arrival_ns.size) == (0, 0, 0)


def test_replies_leave_at_once_on_their_buses(rig):
    replies = make_frames([5, 6, 7], 8)
    rig.far.send(End.DEVICE, np.array([1, 0, 1], np.uint8), replies, np.array([9, 9, 10**18]))
    heard = [np.frombuffer(wire.receive(), CAN_FRAME)["can_id"].tolist() for wire in rig.wires]
    assert heard == [[6], [5, 7]]


def test_what_a_bus_does_not_take_is_counted(rig):
    rig.far.close()
    rig.wires[0].send(make_frames([1, 2], 8).tobytes())
    assert rig.wires[0].dropped == 2
    assert rig.wires[0].receive() == b""


def test_if_one_hub_cannot_be_made_none_is_left(tmp_path):
    first, taken = tmp_path / "can0", tmp_path / "can1"
    other = open_device_end(UNIX, [str(taken)])
    with pytest.raises(DriverConfigError, match=r"can1: no CAN hub can be made there \(another process listens there"):
        open_device_end(UNIX, [str(first), str(taken)])
    assert not first.exists()
    other.close()
    assert not taken.exists()


def test_no_wires_no_frames():
    assert DeviceEnd(()).receive(End.DEVICE, 1).bus.size == 0


def test_a_hub_is_opened_by_name(tmp_path):
    far = open_device_end(UNIX, [str(tmp_path / "can0")])
    bus = open_bus(UNIX, str(tmp_path / "can0"))
    assert isinstance(bus, UnixCanBus)
    bus.shutdown()
    far.close()
    with pytest.raises(DriverConfigError, match="can0: no CAN hub at"):
        open_bus(UNIX, str(tmp_path / "can0"))
