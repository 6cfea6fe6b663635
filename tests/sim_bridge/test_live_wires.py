# SPDX-License-Identifier: Apache-2.0
"""What a fault in real time lays hands on: buses that break, a network that is parted, an injector that is told."""

import json
import os
import selectors
import socket
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.can_frame import make_frames
from drivers.memory_bus import End
from runtime.robots import load_configuration, topics
from runtime.signals import BodyCommand, Gait, Mode, Pose, SafetyStatus
from sim_bridge.faults.buses import bus_down
from sim_bridge.faults.injector import LEFT_M, LOOK_NS, SILENT, STEADY_NS, Injector, Tap
from sim_bridge.faults.joint_drives import no_replies
from sim_bridge.faults.live_buses import LiveBuses
from sim_bridge.faults.live_table import LIVE_ROWS
from sim_bridge.faults.relay import Relay
from sim_bridge.faults.sensors import silent
from sim_bridge.faults.table import ROWS

PATIENCE_S = 60.0
MS = 1_000_000
CONFIG = load_configuration("uslgo1")


@pytest.fixture
def buses(tmp_path):
    made = LiveBuses([str(tmp_path / f"can{bus}") for bus in range(CONFIG.drives.buses)])
    yield made
    made.close()


def host(path):
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.settimeout(PATIENCE_S)
    end.connect(str(path))
    return end


def test_frames_are_changed_or_destroyed_on_their_way(buses, tmp_path):
    heard = []
    buses.heard = lambda received: heard.extend(received.frames["can_id"].tolist())
    first, second = make_frames([1], 8).tobytes(), make_frames([2], 8).tobytes()
    buses.tamper = lambda sender, bus, arrival_ns, frame: None if sender == End.HOST and frame[0] == 1 else frame
    with host(tmp_path / "can1") as end:
        end.send(first)
        end.send(second)
        received = buses.receive(End.DEVICE, 5 * MS)
        assert received.frames["can_id"].tolist() == heard == [2]
        assert received.bus.tolist() == [1]
        buses.tamper = lambda sender, bus, arrival_ns, frame: bytes(16) if arrival_ns == 5 * MS and bus == 1 else frame
        buses.send(End.DEVICE, np.array([1], np.uint8), make_frames([3], 8), 6 * MS)
        assert end.recv(64) == bytes(16)


def test_a_link_that_is_lost_tells_its_ends_and_returns(buses, tmp_path):
    with host(tmp_path / "can0") as end:
        buses.receive(End.DEVICE, 0)
        buses.take_down(0)
        assert end.recv(64) == b""
    with pytest.raises(OSError, match=r"No such file|refused"):
        host(tmp_path / "can0")
    buses.send(End.DEVICE, np.array([0], np.uint8), make_frames([3], 8), 0)
    assert not buses.receive(End.DEVICE, MS).bus.size
    buses.bring_up(0)
    with host(tmp_path / "can0") as end:
        end.send(make_frames([1], 8).tobytes())
        assert buses.receive(End.DEVICE, 2 * MS).bus.tolist() == [0]


def test_nothing_passes_a_parted_network_and_nothing_is_lost_by_it():
    with socket.create_server(("127.0.0.1", 0)) as far, Relay(far.getsockname()[1]) as relay:
        far.settimeout(PATIENCE_S)
        with socket.create_connection(("127.0.0.1", relay.port), PATIENCE_S) as near:
            end, _ = far.accept()
            with end, selectors.DefaultSelector() as selector:
                end.settimeout(PATIENCE_S)
                selector.register(end, selectors.EVENT_READ)
                near.sendall(b"before")
                assert end.recv(64) == b"before"
                relay.partition()
                near.sendall(b"first")  # what the relay is about to pass on may still get through
                near.sendall(b"then")
                relay.heal()
                got = b""
                while len(got) < 9:
                    got += end.recv(64)
                assert got == b"firstthen"
                near.shutdown(socket.SHUT_WR)
                near.close()
                assert end.recv(64) == b""


def test_a_relay_without_a_far_end_lets_its_callers_go():
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    with Relay(port) as relay, socket.create_connection(("127.0.0.1", relay.port), PATIENCE_S) as near:
        assert near.recv(1) == b""


class Port:
    """A pose at each read."""

    def read(self, record, now_ns):
        record.stamp_ns = now_ns
        return True


class Bench:
    """An injector in a world that is made up."""

    def __init__(self, tmp_path, buses):
        self.safety, self.command = SafetyStatus(topics.SAFETY), BodyCommand(topics.BODY_COMMAND)
        self.gait = Gait(topics.GAIT, {"foot": 4, "foot_xyz": 12})
        self.mirror = SimpleNamespace(
            records={topics.SAFETY: self.safety, topics.GAIT: self.gait, topics.BODY_COMMAND: self.command}, taken=0
        )
        drives = SimpleNamespace(driven=True, asked=np.zeros(12), force_error=lambda joint, code: None)
        self.world = SimpleNamespace(
            drives=drives,
            joint_angles=CONFIG.quadruped.standing_angles(0.3),
            joint_velocities=np.zeros(12),
            tilt=0.0,
        )
        self.inputs = {topics.LOCALIZATION: Port()}
        self.told = []
        reading, self.orders = os.pipe()
        faults = {"silent": silent(topics.LOCALIZATION), "no replies": no_replies, "down": bus_down}
        self.injector = Injector(
            CONFIG,
            self.world,
            buses,
            self.inputs,
            self.mirror,
            faults,
            tmp_path,
            lambda **answer: self.told.append(answer),
            reading,
        )
        self.now_ns = 0

    def order(self, **entries):
        os.write(self.orders, json.dumps(entries).encode() + b"\n")

    def walk(self, walking=True, mode=Mode.ACTIVE, speed_mps=0.6, left_m=20.0):
        self.safety.mode, self.gait.walking, self.command.velocity[0] = mode, walking, speed_mps
        self.command.remaining = left_m

    def run(self, duration_ns, silent=False):
        for _ in range(duration_ns // MS):
            self.now_ns += MS
            self.mirror.taken += not silent
            self.injector.step(self.now_ns)

    def answers(self, name):
        return [answer[name] for answer in self.told if name in answer]


@pytest.fixture
def bench(tmp_path, buses):
    made = Bench(tmp_path, buses)
    yield made
    os.close(made.orders)
    os.close(made.injector._orders)


def test_a_fault_strikes_once_the_robot_has_walked_and_is_undone_on_order(bench):
    tap, pose = Tap(bench.inputs, topics.LOCALIZATION), Pose(topics.LOCALIZATION)
    bench.order(fault="silent", seed=3, lasts_ns=1 << 60)
    bench.walk(walking=False)
    bench.run(2 * STEADY_NS)
    bench.walk(speed_mps=0.1)
    bench.run(2 * STEADY_NS)
    bench.walk(left_m=LEFT_M - 0.1)
    bench.run(2 * STEADY_NS)
    assert bench.answers("struck") == []
    bench.walk()
    bench.run(STEADY_NS + CONFIG.gait.period_ns + 2 * LOOK_NS)
    assert bench.answers("struck") == ["silent"]
    assert not tap.read(pose, bench.now_ns)
    bench.order(fault=None)
    bench.run(LOOK_NS)
    assert tap.read(pose, bench.now_ns)
    (seen,) = bench.answers("seen")
    assert seen == {"released_ns": None, "joints_kept": True, "fell": False}


def test_phases_differ_by_seed_and_stay_within_a_gait_cycle(bench):
    begun = []
    for seed in range(6):
        bench.walk(walking=False)
        bench.run(LOOK_NS)
        bench.walk()
        bench.order(fault="", seed=seed)
        start_ns, count = bench.now_ns, len(bench.answers("struck"))
        while len(bench.answers("struck")) == count:
            bench.run(MS)
        begun.append(bench.now_ns - start_ns - STEADY_NS)
        bench.order(fault=None)
        bench.run(LOOK_NS)
    assert len(set(begun)) > 2
    assert all(0 <= phase_ns <= CONFIG.gait.period_ns + 3 * LOOK_NS for phase_ns in begun)


def test_a_robot_that_stumbles_before_the_moment_is_waited_for_with_whole_wires(bench):
    bench.order(fault="no replies", lasts_ns=MS)
    bench.walk()
    bench.run(STEADY_NS + LOOK_NS)
    while bench.injector._buses.tamper is None:
        bench.run(MS)
    assert bench.answers("struck") == []
    bench.walk(mode=Mode.DAMPED)
    bench.run(LOOK_NS)
    assert bench.injector._buses.tamper is None
    assert bench.answers("struck") == []
    bench.walk()
    bench.run(STEADY_NS + CONFIG.gait.period_ns + 2 * LOOK_NS)
    assert bench.answers("struck") == ["no replies"]


def test_the_robots_state_is_told_when_it_changes_and_silence_is_one(bench):
    bench.walk(mode=Mode.STANDING)
    bench.run(100 * MS)
    bench.run(400 * MS, silent=True)
    bench.walk()
    bench.run(20 * MS)
    assert bench.answers("state") == ["STANDING", SILENT, "ACTIVE"]


def test_the_witness_sees_joints_beyond_their_limits_until_the_drives_let_go(bench):
    for beyond, released in ((True, False), (True, True)):
        bench.walk(walking=False)
        bench.run(LOOK_NS)
        bench.walk()
        bench.order(fault="")
        bench.run(STEADY_NS + CONFIG.gait.period_ns + 3 * LOOK_NS)
        bench.world.drives.driven = not released
        bench.run(2 * MS)
        bench.world.joint_angles = np.full(12, 9.0) if beyond else bench.world.joint_angles
        bench.run(2 * MS)
        bench.order(fault=None)
        bench.run(LOOK_NS)
        seen = bench.answers("seen")[-1]
        assert seen["joints_kept"] == released
        assert (seen["released_ns"] is not None) == released
        bench.world.joint_angles, bench.world.drives.driven = CONFIG.quadruped.standing_angles(0.3), True


def test_the_table_of_real_time_names_each_fault_once_and_takes_the_wires_from_that_of_virtual_time():
    names = [row.name for row in LIVE_ROWS]
    assert len(set(names)) == len(names)
    virtual = {row.name: row.inject for row in ROWS}
    shared = [row for row in LIVE_ROWS if row.name in virtual]
    assert len(shared) >= 10
    assert all(row.inject is virtual[row.name] for row in shared)
    assert all((row.inject is None) != (row.act is None) for row in LIVE_ROWS)
