# SPDX-License-Identifier: Apache-2.0
"""Commands and replies on real CAN interfaces, with our drives and with can-utils at the far end."""

import dataclasses
import subprocess
import time

import numpy as np
import pytest

from drivers.bus_health import BusState
from drivers.device_end import open_device_end
from drivers.dialects import dialect_named
from drivers.joint_group import JointGroup, Readings
from drivers.memory_bus import End
from drivers.opening import SOCKETCAN
from drivers.socket_ports import SocketReader, SocketWriter
from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import sizes
from runtime.signals import CanFrames
from sim_bridge.quadruped_world import drive_model
from sim_bridge.virtual_drive import VirtualDrives

CONFIG = load_configuration("uslgo1")
JOINTS = CONFIG.drives.joints(CONFIG.safety)
DIALECT = dialect_named(CONFIG.drives.dialect)
QUIET = dataclasses.replace(drive_model(CONFIG.simulation), velocity_noise=0.0)
BUSES = [f"vcan{bus}" for bus in range(CONFIG.drives.buses)]
ANGLES = CONFIG.quadruped.standing_angles(0.29)


class Controller:
    """Our end: the joint group on its ports."""

    def __init__(self, buses):
        self.buses = buses
        self.group = JointGroup(JOINTS, DIALECT, CONFIG.drives.command_age_max_ns)
        self.readings = Readings.empty(len(JOINTS))
        self.received, self.sent = CanFrames("received", sizes(CONFIG)), CanFrames("sent", sizes(CONFIG))
        self._reader, self._writer = SocketReader(buses), SocketWriter(buses)

    def send(self, frames):
        self.sent.count = len(JOINTS)
        self.sent.bus[: len(JOINTS)] = self.group.bus
        self.sent.data[: 16 * len(JOINTS)] = np.frombuffer(frames.tobytes(), np.uint8)
        self._writer.write(self.sent, time.monotonic_ns())

    def command(self, position, effort):
        now_ns = time.monotonic_ns()
        n = len(JOINTS)
        self.send(self.group.encode(position, np.zeros(n), effort, np.full(n, 30.0), np.ones(n), now_ns, now_ns))

    def decode(self):
        """How many replies came."""
        self._reader.read(self.received, time.monotonic_ns())
        frames = self.received.data.view(self.group.frames.dtype)
        return self.group.decode(
            frames, self.received.bus, self.received.arrival_ns, self.received.count, self.readings
        )


@pytest.fixture
def controller(links, opened):
    links(len(BUSES))
    return Controller(opened(*BUSES))


def test_every_drive_gets_its_command_and_answers(controller, until):
    far, drives = open_device_end(SOCKETCAN, BUSES), VirtualDrives(JOINTS, DIALECT, QUIET, 0)
    replies = 0

    def exchange():
        nonlocal replies
        arrived = far.receive(End.DEVICE, time.monotonic_ns())
        if len(arrived.bus):
            frames, bus, at_ns = drives.answer(*arrived)
            far.send(End.DEVICE, bus, frames, at_ns)
        replies += controller.decode()
        return replies == len(JOINTS)

    for frames in (controller.group.enable_frames(), None):
        begin_ns, replies = time.monotonic_ns(), 0
        drives.torque(ANGLES, np.zeros(12), begin_ns)
        controller.send(frames) if frames is not None else controller.command(ANGLES, np.full(12, 2.0))
        until(exchange, "twelve replies")
        assert (controller.readings.reply_ns >= begin_ns).all()
    far.close()
    assert drives.enabled.all()
    assert drives.torque(ANGLES, np.zeros(12), time.monotonic_ns()) == pytest.approx(np.full(12, 2.0), abs=0.05)
    assert controller.readings.position == pytest.approx(ANGLES, abs=5e-4)
    assert not controller.group.counters.any()
    assert not drives.rejections.any()
    assert [bus.health.state for bus in controller.buses] == [BusState.UP] * len(BUSES)


# -- can-utils --------------------------------------------------------------------------------------------------------


def code(value, ends, bits):
    """A value in a field of so many bits, as the drives' manual has it."""
    low, high = ends
    return (value - low) * (2**bits - 1) / (high - low)


def drive_position(index, angle):
    joint = JOINTS[index]
    return joint.direction * joint.gear_ratio * (angle - joint.offset)


def listens(name):
    """Whether a socket that receives every frame is on an interface, besides ours."""
    with open("/proc/net/can/rcvlist_all") as table:
        return sum(line.split()[:1] == [name] for line in table) >= 2


def test_candump_shows_the_bytes_that_a_drive_expects(controller, until):
    dump = subprocess.Popen(["candump", "-L", "-n", "3", "vcan0"], stdout=subprocess.PIPE, text=True)
    until(lambda: listens("vcan0"), "candump")
    effort = np.linspace(-3.0, 3.0, 12)
    controller.command(ANGLES, effort)
    lines = dump.communicate(timeout=60)[0].splitlines()
    ranges = JOINTS[0].ranges
    for index, line in enumerate(lines):
        identifier, data = line.split()[-1].split("#")
        assert int(identifier, 16) == JOINTS[index].drive_id
        word = int(data, 16)
        wanted = drive_position(index, ANGLES[index]), 0.0, 30.0, 1.0, JOINTS[index].direction * effort[index]
        fields = word >> 48, word >> 36 & 0xFFF, word >> 24 & 0xFFF, word >> 12 & 0xFFF, word & 0xFFF
        ends = ranges.position, ranges.velocity, ranges.stiffness, ranges.damping, ranges.effort
        for value, field, limits, bits in zip(wanted, fields, ends, (16, 12, 12, 12, 12), strict=True):
            assert abs(field - code(value, limits, bits)) <= 1
    assert len(lines) == 3


def test_a_reply_of_cansend_is_read_as_the_drives_manual_has_it(controller, until):
    ranges, index = JOINTS[4].ranges, 4
    position = round(code(drive_position(index, ANGLES[index]), ranges.position, 16))
    velocity, effort = 2048 + 300, 2048 - 200
    word = JOINTS[index].drive_id << 40 | position << 24 | velocity << 12 | effort
    text = f"{JOINTS[index].master_id:03X}#{word:012X}3700"
    subprocess.run(["cansend", f"vcan{JOINTS[index].bus}", text], check=True)
    until(controller.decode, "the reply")
    readings, direction = controller.readings, JOINTS[index].direction
    low, high = ranges.velocity
    assert readings.position[index] == pytest.approx(ANGLES[index], abs=5e-4)
    assert readings.velocity[index] == pytest.approx(direction * (low + velocity * (high - low) / 4095))
    low, high = ranges.effort
    assert readings.effort[index] == pytest.approx(direction * (low + effort * (high - low) / 4095))
    assert (readings.temperature[index], readings.error[index]) == (0x37, 0)
    assert np.flatnonzero(readings.reply_ns).tolist() == [index]
