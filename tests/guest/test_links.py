# SPDX-License-Identifier: Apache-2.0
"""On real CAN interfaces: whatever happens to a link is counted, never raised, and over when the link is back."""

import os
import random
import subprocess
import time
from types import SimpleNamespace

import pytest

from drivers import bus_socket
from drivers.bus_health import BusMonitor, BusState
from drivers.bus_socket import RETRY_NS, open_buses
from drivers.can_frame import CAN_ERR_FLAG, as_frames, make_frames
from drivers.errors import DriverConfigError
from drivers.opening import SOCKETCAN
from drivers.socket_ports import SocketReader, SocketWriter
from runtime.signals import BusStatus, CanFrames

SECOND_NS = 1_000_000_000
CAPACITY = 16
DELAYED = ["netem", "delay", "200ms", "limit", "20"]
"""A queue with room for 20 frames, whoever they are of."""
CRAWLING = ["tbf", "rate", "8kbit", "burst", "100", "limit", "100000"]
"""One with room for all, but too slow for any."""
BUS_OFF, RESTARTED, CONTROLLER = (CAN_ERR_FLAG | each for each in (0x40, 0x100, 0x04))


class Ports:
    """What a loop has of its buses."""

    def __init__(self, buses):
        sizes = {"frame": CAPACITY, "frame_byte": 16 * CAPACITY, "bus": len(buses)}
        self.received, self.sent = CanFrames("received", sizes), CanFrames("sent", sizes)
        self.status = BusStatus("status", sizes)
        self._reader, self._writer = SocketReader(buses), SocketWriter(buses)
        self._monitor = BusMonitor([bus.health for bus in buses])
        self._ahead_ns = 0

    def now_ns(self):
        return time.monotonic_ns() + self._ahead_ns

    def wait(self, time_ns):
        """Let time pass for the ports alone."""
        self._ahead_ns += time_ns

    def tick(self):
        """Read the frames, as (bus, identifier), and the state of the buses."""
        now_ns = self.now_ns()
        self._reader.read(self.received, now_ns)
        self._monitor.read(self.status, now_ns)
        count = self.received.count
        identifiers = as_frames(self.received.data)["can_id"][:count]
        return list(zip(self.received.bus[:count].tolist(), identifiers.tolist(), strict=True))

    def send(self, *frames):
        """Send (bus, identifier)."""
        self.sent.count = len(frames)
        self.sent.bus[: len(frames)] = [bus for bus, _ in frames]
        as_frames(self.sent.data)[: len(frames)] = make_frames([can_id for _, can_id in frames], 8)
        self._writer.write(self.sent, self.now_ns())


@pytest.fixture
def ports(opened):
    return lambda *names: Ports(opened(*names))


# -- errors of the controller -----------------------------------------------------------------------------------------


def test_error_frames_tell_the_state_of_the_controller_and_are_in_the_batch(links, peer, ports, until):
    links(2)
    far, near = peer("vcan1"), ports("vcan0", "vcan1")
    for errors, (can_id, data, state) in enumerate(
        [
            (CONTROLLER, bytes([0, 0x30]), BusState.PASSIVE),
            (CONTROLLER, bytes([0, 0x40]), BusState.UP),
            (BUS_OFF, bytes(8), BusState.OFF),
            (RESTARTED, bytes(8), BusState.UP),
        ],
        start=1,
    ):
        far.send(can_id, data.ljust(8, b"\0"))
        assert until(near.tick, "the error frame") == [(1, can_id)]
        assert near.status.state.tolist() == [BusState.UP, state]
        assert near.status.errors.tolist() == [0, errors]


def test_nothing_is_sent_while_the_bus_is_off(links, peer, ports, until):
    links(1)
    far, near = peer("vcan0"), ports("vcan0")
    far.send(BUS_OFF)
    until(near.tick, "bus-off")
    near.send((0, 1), (0, 2))
    far.send(RESTARTED)
    until(near.tick, "the restart")
    near.send((0, 3))
    assert far.receive()[0] == 3
    near.tick()
    assert near.status.failed.tolist() == [2]


# -- links ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", ["read", "write"])
@pytest.mark.parametrize("loss", ["down", "delete"])
def test_a_link_that_is_lost_returns(loss, first, links, peer, ports, until):
    link, near = links(2)[0], ports("vcan0", "vcan1")
    getattr(link, loss)()
    near.tick() if first == "read" else near.send((0, 1))
    near.send((0, 2), (1, 2))
    near.tick()
    assert near.status.state.tolist() == [BusState.DOWN, BusState.UP]
    assert near.status.failed.tolist() == [2, 0]
    near.wait(RETRY_NS)
    near.tick()
    assert near.status.state.tolist() == [BusState.DOWN, BusState.UP]
    link.up() if loss == "down" else link.create()
    near.wait(RETRY_NS)
    near.tick()
    assert near.status.state.tolist() == [BusState.UP, BusState.UP]
    far = peer("vcan0")
    near.send((0, 3))
    assert far.receive()[0] == 3
    far.send(4)
    assert until(near.tick, "a frame") == [(0, 4)]


def test_frames_from_before_the_loss_are_purged(links, peer, ports):
    link, witness = links(1)[0], peer("vcan0")
    near, far = ports("vcan0"), peer("vcan0")
    for can_id in range(5):
        far.send(can_id)
        assert witness.receive()[0] == can_id  # it is served after us, who came later
    link.down()
    near.send((0, 1))
    link.up()
    near.wait(RETRY_NS)
    assert near.tick() == []
    assert near.status.state.tolist() == [BusState.UP]
    assert near.status.purged.tolist() == [5]


def test_commands_from_before_the_loss_do_not_leave_the_kernel(links, peer, ports):
    link, near = links(1)[0], ports("vcan0")
    link.slow(*DELAYED)
    near.send((0, 1), (0, 2))
    link.down()
    near.send((0, 3))
    link.up()
    near.wait(RETRY_NS)
    near.tick()
    far = peer("vcan0")
    near.send((0, 4))
    assert far.receive()[0] == 4


def test_a_link_that_is_not_there_at_the_start_is_refused_in_one_sentence(links):
    links(2)[1].delete()
    with pytest.raises(DriverConfigError, match="vcan1: there is no such"):
        open_buses(SOCKETCAN, ["vcan0", "vcan1"])


def test_a_link_that_is_down_at_the_start_is_opened_when_it_is_up(links, peer, ports):
    link = links(2)[1]
    link.down()
    near = ports("vcan0", "vcan1")
    near.send((0, 1), (1, 2))
    assert near.tick() == []
    assert near.status.state.tolist() == [BusState.UP, BusState.DOWN]
    assert near.status.failed.tolist() == [0, 1]
    link.up()
    near.wait(RETRY_NS)
    near.tick()
    assert near.status.state.tolist() == [BusState.UP, BusState.UP]
    far = peer("vcan1")
    near.send((1, 3))
    assert far.receive()[0] == 3


# -- too much ---------------------------------------------------------------------------------------------------------


def test_a_bus_that_takes_nothing_lets_little_wait_in_the_kernel(links, ports):
    links(1)[0].slow(*CRAWLING)
    near = ports("vcan0")
    for _ in range(100):
        near.send((0, 1))
    near.tick()
    assert near.status.state.tolist() == [BusState.UP]
    assert near.status.refused[0] > 60


def test_a_full_queue_of_the_interface_is_counted_as_well(links, ports):
    links(1)[0].slow(*DELAYED)
    near = ports("vcan0")
    for _ in range(60):
        near.send((0, 1))
    near.tick()
    assert near.status.state.tolist() == [BusState.UP]
    assert near.status.refused.tolist() == [40]


def test_every_frame_is_read_or_counted_as_overflow(links, peer, ports, until):
    links(1)
    far, near = peer("vcan0"), ports("vcan0")
    sent, last = 2000, 2
    for _ in range(sent):
        far.send(1)
    read, floods = len(until(near.tick, "the first frames")), int(near.status.backlog[0])
    while frames := near.tick():
        assert len(frames) <= CAPACITY
        read, floods = read + len(frames), floods + int(near.status.backlog[0])
    assert floods > 0
    far.send(last)  # carries the count
    while (0, last) not in (frames := until(near.tick, "the last frame")):
        read += len(frames)
    read += len(frames) - 1
    assert near.status.overflow.tolist() == [sent - read]
    assert near.received.lost == sent - read > 0


def test_a_flood_leaves_the_other_bus_its_share(links, peer, ports, until):
    links(2)
    far, near = peer("vcan1"), ports("vcan0", "vcan1")
    with subprocess.Popen(["cangen", "vcan0", "-g", "0", "-n", "5000", "-I", "7", "-L", "8", "-i"]) as flood:
        floods = 0
        for can_id in range(50):
            far.send(0x100 | can_id)
            heard = []
            while (1, 0x100 | can_id) not in heard:
                heard = until(near.tick, "a frame beside the flood")
                assert sum(bus == 0 for bus, _ in heard) <= CAPACITY // 2
                floods += int(near.status.backlog[0])
                assert not near.status.backlog[1]
        while flood.poll() is None or near.tick():
            near.tick()
            floods += int(near.status.backlog[0])
    assert floods > 0
    assert not near.status.backlog.any()


# -- time -------------------------------------------------------------------------------------------------------------


def test_a_frame_is_stamped_when_the_kernel_got_it(links, peer, ports):
    links(1)
    witness, near, far = peer("vcan0"), ports("vcan0"), peer("vcan0")
    sent_ns = near.now_ns()
    far.send(1)
    witness.receive()  # it is served after us, who came later
    near.wait(1000 * SECOND_NS)
    assert near.tick() == [(0, 1)]
    assert abs(near.received.arrival_ns[0] - sent_ns) < 500 * SECOND_NS < near.received.stamp_ns - sent_ns


@pytest.mark.parametrize("step_s", [-3600, 3600])
def test_a_clock_that_is_set_meanwhile_moves_a_stamp_no_further_than_the_reads(
    step_s, links, peer, ports, until, monkeypatch
):
    links(1)
    far, near = peer("vcan0"), ports("vcan0")
    begin_ns = near.now_ns()
    near.tick()
    far.send(1)
    clock = SimpleNamespace(monotonic_ns=time.monotonic_ns, time_ns=lambda: time.time_ns() + step_s * SECOND_NS)
    monkeypatch.setattr(bus_socket, "time", clock)
    assert until(near.tick, "the frame") == [(0, 1)]
    assert begin_ns <= near.received.arrival_ns[0] <= near.received.stamp_ns


# -- all of it --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_whatever_happens_in_whatever_order_nothing_is_raised_and_the_end_is_good(seed, links, ports, peer):
    link = links(1)[0]
    near, rng = ports("vcan0"), random.Random(seed)
    there = raised = True
    descriptors = len(os.listdir("/proc/self/fd"))
    for _ in range(40):
        event = rng.choice(["down", "up", "delete", "create", "error", "noise", "send", "wait"])
        if event in ("down", "up") and there:
            getattr(link, event)()
            raised = event == "up"
        elif event == "delete" and there:
            link.delete()
            there = raised = False
        elif event == "create" and not there:
            link.create()
            there = raised = True
        elif event in ("error", "noise") and raised:
            frame = make_frames([rng.getrandbits(29) | (CAN_ERR_FLAG if event == "error" else 0)], 8).tobytes()
            subprocess.run(
                ["cansend", "vcan0", f"{int.from_bytes(frame[:4], 'little'):08X}#{frame[8:].hex()}"], check=True
            )
        elif event == "send":
            near.send(*[(0, rng.getrandbits(11)) for _ in range(rng.randrange(4))])
        elif event == "wait":
            near.wait(RETRY_NS)
        near.tick()
    if there:
        link.delete()
    near.tick()
    link.create()
    near.wait(RETRY_NS)
    near.tick()
    assert near.status.state.tolist() == [BusState.UP]
    assert len(os.listdir("/proc/self/fd")) == descriptors
    far = peer("vcan0")
    near.send((0, 3))
    assert far.receive()[0] == 3
