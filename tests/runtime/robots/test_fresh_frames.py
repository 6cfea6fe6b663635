# SPDX-License-Identifier: Apache-2.0
"""No command that became too old on its way reaches a bus."""

from contextlib import ExitStack, closing

from hypothesis import given
from hypothesis import strategies as st

from drivers.bus_health import BusMonitor
from drivers.bus_socket import open_buses
from drivers.memory_bus import MemoryBus
from drivers.memory_ports import MemoryWriter
from drivers.opening import UNIX
from drivers.socket_ports import SocketWriter
from drivers.unix_hub import UnixHub
from runtime.robots.fresh_frames import FreshFrames
from runtime.signals import BusStatus, CanFrames

SIZES = {"frame": 4, "frame_byte": 64}
BOUND_NS = 10_000_000


class Wire(list):
    withheld = 0

    def withhold(self, record):
        self.withheld += 1

    def write(self, record, now_ns):
        self.append(now_ns - record.stamp_ns)


@given(st.lists(st.integers(0, 3 * BOUND_NS), max_size=20))
def test_only_what_is_fresh_passes_and_the_rest_is_counted(ages):
    wire, frames = Wire(), CanFrames("/frames", SIZES)
    gate = FreshFrames(wire, BOUND_NS)
    for age_ns in ages:
        frames.stamp_ns = 10**9
        gate.write(frames, 10**9 + age_ns)
    assert list(wire) == [age_ns for age_ns in ages if age_ns <= BOUND_NS]
    assert wire.withheld == len(ages) - len(wire)


def status():
    return BusStatus("/status", {"bus": 2})


def batch(stamp_ns):
    frames = CanFrames("/frames", {"frame": 4, "frame_byte": 64})
    frames.stamp_ns, frames.count = stamp_ns, 3
    frames.bus[:3] = (0, 1, 1)
    return frames


def test_what_is_withheld_stands_in_the_state_of_the_buses_in_memory():
    bus, record = MemoryBus(2), status()
    monitor, gate = BusMonitor(bus.health), FreshFrames(MemoryWriter(bus), BOUND_NS)
    gate.write(batch(10**9), 10**9 + BOUND_NS)
    assert not monitor.read(record, 10**9)
    gate.write(batch(10**9), 10**9 + BOUND_NS + 1)
    assert monitor.read(record, 10**9)
    assert record.withheld.tolist() == [1, 2]


def test_what_is_withheld_stands_in_the_state_of_real_buses(tmp_path):
    with ExitStack() as stack:
        hubs = [stack.enter_context(closing(UnixHub(tmp_path / f"can{bus}"))) for bus in range(2)]
        buses = [stack.enter_context(closing(bus)) for bus in open_buses(UNIX, [str(hub.path) for hub in hubs])]
        record, monitor = status(), BusMonitor([bus.health for bus in buses])
        gate = FreshFrames(SocketWriter(buses), BOUND_NS)
        for _ in range(2):
            gate.write(batch(10**9), 10**9 + BOUND_NS + 1)
        assert monitor.read(record, 10**9)
        assert record.withheld.tolist() == [2, 4]
        assert [hub.receive() for hub in hubs] == [b"", b""]
