# SPDX-License-Identifier: Apache-2.0
"""A robot that walks on CAN interfaces of the kernel, in virtual time, and what it does when they break."""

import numpy as np
import pytest

from drivers.bus_health import BusMonitor
from drivers.can_frame import CAN_ERR_FLAG
from drivers.device_end import open_device_end
from drivers.opening import SOCKETCAN
from drivers.socket_ports import SocketReader, SocketWriter
from runtime.executors.lockstep import Lockstep
from runtime.robots import assembled, load_configuration, topics
from runtime.robots.fresh_frames import FreshFrames
from runtime.signals import Fault, Mode
from sim_bridge.courses import scenario
from sim_bridge.faults.walk import WALKING_NS
from sim_bridge.run import NullSink
from sim_bridge.script import ScriptedPath
from sim_bridge.simulation import simulation_of

CONFIG = load_configuration("uslgo1")
BUSES = [f"vcan{bus}" for bus in range(CONFIG.drives.buses)]
BROKEN = 1
TICK_NS = CONFIG.loops.wbc_period_ns
MS = 1_000_000
FAR_TOO_MANY, CRAWLING = 2000, ["tbf", "rate", "8kbit", "burst", "100", "limit", "100000"]


class AtOnce:
    """Frames that are there when they are read have come in virtual time, not in the kernel's."""

    def __init__(self, reader):
        self._reader = reader

    def read(self, record, now_ns):
        changed = self._reader.read(record, now_ns)
        record.arrival_ns[: record.count] = now_ns
        return changed


class Walk:
    """A robot and its world with the kernel between them."""

    def __init__(self, buses):
        simulation, course = simulation_of(CONFIG), scenario("flat")
        self.world = simulation.world(course, course.terrain(0), open_device_end(SOCKETCAN, BUSES), 0)
        loops = assembled(CONFIG).loops
        self.records = {r.topic: r for loop in loops for r in (*loop.port_inputs, *loop.writes)}
        self.status = self.records[topics.SAFETY]
        inputs = {
            topics.CAN_RECEIVED: AtOnce(SocketReader(buses)),
            topics.BUS_STATUS: BusMonitor([bus.health for bus in buses]),
            **simulation.sensors(self.world),
            topics.TRUTH: self.world,
            topics.OPERATOR_EVENT: simulation.operator(course, self.world),
            topics.PATH: ScriptedPath(course),
        }
        outputs = {topics.CAN_SENT: FreshFrames(SocketWriter(buses), CONFIG.drives.command_age_max_ns)}
        self._executor = Lockstep(loops, inputs, outputs, self.world, NullSink())
        self.now_ns = 0
        self.run(WALKING_NS)
        assert self.status.mode == Mode.ACTIVE
        assert self.records[topics.GAIT].walking
        assert not self.status.faults

    def run(self, duration_ns, stop=lambda: False):
        """Let time pass, at most until something has come true."""
        self.now_ns = self._executor.run(self.now_ns + duration_ns, lambda now_ns: stop())


@pytest.fixture
def walk(links, opened):
    """The robot, and the interface that is to break."""
    return lambda: (links(len(BUSES))[BROKEN], Walk(opened(*BUSES)))


def down(link, far):
    link.down()


def gone(link, far):
    link.delete()


def off(link, far):
    far().send(CAN_ERR_FLAG | 0x40)


def flooded(link, far):
    babbler = far()
    for _ in range(FAR_TOO_MANY):
        babbler.send(0)


def full(link, far):
    link.slow(*CRAWLING)


@pytest.mark.parametrize("fault", [down, gone, off, flooded, full])
def test_a_bus_that_fails_damps_the_robot_at_once_and_for_good(fault, walk, peer):
    link, robot = walk()
    fault(link, lambda: peer(BUSES[BROKEN]))
    robot.run(200 * MS, lambda: robot.status.mode == Mode.DAMPED)
    broken_ns = robot.now_ns - WALKING_NS
    assert Fault(robot.status.fault) & Fault.BUS
    assert broken_ns <= {full: 60 * MS}.get(fault, 3 * TICK_NS)
    robot.run(CONFIG.simulation.command_timeout_ns + 2 * TICK_NS)
    assert not robot.world.drives.driven
    robot.run(300 * MS)
    assert robot.status.mode == Mode.DAMPED
    assert not robot.world.drives.driven


def test_frames_of_no_meaning_are_counted_and_the_robot_walks_on(walk, peer):
    _, robot = walk()
    babbler, rng, before = peer(BUSES[BROKEN]), np.random.default_rng(0), robot.records[topics.JOINT_STATE].rejected
    for _ in range(100):
        babbler.send(int(rng.integers(0x700)), rng.bytes(int(rng.integers(9))))
        robot.run(TICK_NS)
    assert robot.status.mode == Mode.ACTIVE
    assert not robot.status.faults
    assert robot.records[topics.JOINT_STATE].rejected - before > 90


def test_a_drive_that_no_longer_answers_is_bridged_and_then_damps_the_robot(walk):
    _, robot = walk()
    robot.world.drives.mute(4)
    robot.run(200 * MS, lambda: robot.status.mode == Mode.DAMPED)
    ticks = (robot.now_ns - WALKING_NS) // TICK_NS
    assert Fault(robot.status.fault) & Fault.STALE_MOTOR
    assert CONFIG.safety.missing_replies_max <= ticks <= CONFIG.safety.missing_replies_max + 3
