# SPDX-License-Identifier: Apache-2.0
"""A run against the wall clock makes CAN interfaces of its own, and leaves none behind."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drivers.bus_socket import open_buses
from drivers.can_frame import make_frames
from drivers.device_end import open_device_end
from drivers.memory_bus import End
from drivers.opening import SOCKETCAN, UNIX
from drivers.unix_hub import UnixHub
from runtime.recording.log import Log
from runtime.robots import topics
from sim_bridge.live_buses import live_buses
from sim_bridge.live_run import run_live
from sim_bridge.virtual_links import remove_orphaned_links

BUSES, WORLD_TIME_S = 4, 3.0
GUEST = "User Mode Linux" in Path("/proc/cpuinfo").read_text()
HOLDER = """
from sim_bridge.virtual_links import virtual_links
with virtual_links(2) as names:
    print(*names, flush=True)
    input()
"""


def interfaces():
    return {name for _, name in socket.if_nameindex()}


@pytest.fixture
def holder():
    """Another process with two interfaces; gives it and their names."""
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", HOLDER], stdin=pipe, stdout=pipe, text=True) as process:
        yield process, set(process.stdout.readline().split())
        process.kill()


def test_the_kernels_interfaces_are_chosen_and_said_so(tmp_path):
    before = interfaces()
    with live_buses(BUSES, tmp_path) as buses:
        assert buses.interface == SOCKETCAN
        assert interfaces() - before == set(buses.channels)
        assert all(name in buses.note for name in buses.channels)
    assert interfaces() == before
    assert list(tmp_path.iterdir()) == []


def test_frames_go_both_ways_on_each(tmp_path, until):
    with live_buses(BUSES, tmp_path) as buses:
        far, near = open_device_end(buses.interface, buses.channels), open_buses(buses.interface, buses.channels)
        for index, bus in enumerate(near):
            command, reply = make_frames([0x10 + index], 8), make_frames([0x20 + index], 8)
            bus.send(command.tobytes(), 0)
            arrived = until(
                lambda: [part.tobytes() for part in far.receive(End.DEVICE, 0)[:2] if part.size], "a command"
            )
            assert arrived == [command.tobytes(), bytes([index])]
            far.send(End.DEVICE, np.array([index], np.uint8), reply, 0)
            assert until(lambda bus=bus: bus.receive(2, 0)[0], "a reply") == reply.tobytes()
        for end in (far, *near):
            end.close()


def test_what_is_there_already_stays_and_so_do_those_of_a_run_beside_it(links, holder, tmp_path):
    links(1)
    process, others = holder
    before = interfaces()
    assert {"vcan0", *others} <= before
    with live_buses(BUSES, tmp_path) as buses:
        assert not before & set(buses.channels)
    assert interfaces() == before
    process.communicate("\n")
    assert interfaces() == before - others


@pytest.mark.parametrize("remover", ["a process that outlives it", "the next run"])
def test_those_of_a_run_that_was_killed_are_removed(remover, links, holder, tmp_path):
    links(1)
    process, left = holder
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert left <= interfaces()
    if remover == "the next run":
        with live_buses(BUSES, tmp_path):
            assert not left & interfaces()
    else:
        remove_orphaned_links()
    assert not left & interfaces()
    assert "vcan0" in interfaces()


def test_a_user_who_may_make_none_gets_hubs(tmp_path):
    """In a child, which gives up root."""
    child = os.fork()
    if not child:
        os.setuid(65534)
        with live_buses(BUSES, tmp_path) as buses:
            refused = buses.interface == UNIX and "not permitted" in buses.note
            os._exit(0 if refused else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_if_one_cannot_be_made_none_is_left(tmp_path, monkeypatch):
    before = interfaces()
    monkeypatch.setattr("sim_bridge.virtual_links.secrets.token_hex", lambda count: "0123abcd")
    subprocess.run(["ip", "link", "add", "ugv0123abcd-3", "type", "vcan"], check=True)
    monkeypatch.setattr("sim_bridge.virtual_links.remove_orphaned_links", lambda: None)
    with live_buses(BUSES, tmp_path) as buses:
        assert (buses.interface, "exists" in buses.note) == (UNIX, True)
        UnixHub(tmp_path / "can0").close()
        assert interfaces() == before | {"ugv0123abcd-3"}
    remove_orphaned_links()


@pytest.mark.skipif(
    GUEST,
    reason="in a guest the loops take ten times as long as they have, so only control runs there, slowly and by itself "
    "(test_control_process.py): run it where the kernel has CAN",
)
def test_the_processes_of_a_run_speak_over_them(tmp_path, capsys):
    before = interfaces()
    summary = run_live("uslgo1", "stand", until_s=WORLD_TIME_S, out=tmp_path)
    assert "(vcan)" in capsys.readouterr().err
    assert summary["sim_time_s"] >= WORLD_TIME_S
    counts = Log(tmp_path).counts()
    assert counts[topics.CAN_SENT]
    assert counts[topics.CAN_RECEIVED]
    assert interfaces() == before
