# SPDX-License-Identifier: Apache-2.0
"""CAN interfaces of the kernel: made, set down and up, deleted, and listened to by sockets that are not ours."""

import os
import socket
import struct
import subprocess
import time

import pytest

from drivers.bus_socket import open_buses
from drivers.opening import SOCKETCAN

PATIENCE_S = 60.0
"""The guest is slow; nothing here depends on how slow."""
FRAME = struct.Struct("=IB3x8s")


@pytest.fixture(scope="session", autouse=True)
def _kernel():
    """Fails rather than skips: who runs these tests wants them run."""
    try:
        ip("link", "add", "vcanprobe", "type", "vcan")
    except subprocess.CalledProcessError as error:
        pytest.exit(f"no CAN interface can be made here ({error.stderr.strip()}): use make test-guest", 2)
    ip("link", "del", "vcanprobe")


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)


def until(happens, what):
    """What `happens()` returns as soon as it is true."""
    give_up = time.monotonic() + PATIENCE_S
    while not (result := happens()):
        assert time.monotonic() < give_up, f"{what}: not within {PATIENCE_S:g} s"
        os.sched_yield()
    return result


class Link:
    """A CAN interface."""

    def __init__(self, name):
        self.name = name
        self.create()

    def create(self):
        ip("link", "add", self.name, "up", "type", "vcan")

    def up(self):
        ip("link", "set", self.name, "up")

    def down(self):
        ip("link", "set", self.name, "down")

    def delete(self):
        ip("link", "del", self.name)

    def slow(self, *queue):
        """Let frames wait in a queue of the interface, as `tc qdisc` describes it."""
        subprocess.run(["tc", "qdisc", "replace", "dev", self.name, "root", *queue], check=True)


class Peer:
    """A plain socket at the other end of an interface."""

    def __init__(self, name):
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((name,))
        self._socket.settimeout(PATIENCE_S)

    def send(self, can_id, data=bytes(8)):
        """Send one frame; the error flag makes it a controller's report, as only a virtual interface lets one."""
        self._socket.send(FRAME.pack(can_id, len(data), data))

    def receive(self):
        can_id, length, data = FRAME.unpack(self._socket.recv(FRAME.size))
        return can_id, data[:length]

    def close(self):
        self._socket.close()


@pytest.fixture
def links():
    """Makes interfaces vcan0, vcan1..."""
    made = []

    def make(count):
        made.extend(Link(f"vcan{index}") for index in range(count))
        return made

    yield make
    for link in made:
        subprocess.run(["ip", "link", "del", link.name], capture_output=True)


@pytest.fixture
def peer():
    """Makes peers by the names of their interfaces."""
    made = []

    def make(name):
        made.append(Peer(name))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def opened():
    """Opens our ends of interfaces by their names."""
    made = []

    def make(*names):
        buses = open_buses(SOCKETCAN, names)
        made.extend(buses)
        return buses

    yield make
    for bus in made:
        bus.close()


@pytest.fixture(name="until")
def _until():
    return until
