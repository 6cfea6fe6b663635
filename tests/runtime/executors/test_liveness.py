# SPDX-License-Identifier: Apache-2.0
"""The service manager hears that a robot is ready and alive only while every loop advances."""

import socket

import pytest

from runtime.executors.liveness import ALIVE_EVERY_NS, READY_AFTER_TICKS, Liveness
from runtime.executors.notify import Notifier


@pytest.fixture(params=["file", "abstract"])
def manager(request, tmp_path):
    address = str(tmp_path / "notify") if request.param == "file" else f"@ugv-test-{tmp_path.name}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as end:
        end.bind("\0" + address[1:] if address.startswith("@") else address)
        yield end, address


class Manager(list):
    def send(self, state):
        self.append(state)


def test_a_state_reaches_the_manager(manager):
    end, address = manager
    Notifier(address).send("READY=1")
    assert end.recv(100) == b"READY=1"


def test_without_a_manager_nothing_is_told_and_nothing_raised(tmp_path):
    Notifier("").send("READY=1")
    Notifier(str(tmp_path / "nobody")).send("READY=1")


def test_ready_is_told_once_after_ticks_in_a_row_that_were_on_time():
    manager = Manager()
    liveness = Liveness(manager)
    for index in range(READY_AFTER_TICKS - 1):
        liveness.ticked((index + 1,), True, 0)
    liveness.ticked((READY_AFTER_TICKS,), False, 0)
    assert manager == [f"STATUS=1 ticks on time in a row; ready at {READY_AFTER_TICKS}"]
    for index in range(2 * READY_AFTER_TICKS):
        liveness.ticked((index,), True, 0)
    assert manager[1:] == ["STATUS=the loops keep time", "READY=1"]


@pytest.mark.parametrize("on_time", [0, 1, READY_AFTER_TICKS - 1])
def test_loops_at_normal_priority_are_ready_after_as_many_ticks_and_say_how_many_were_late(on_time):
    manager = Manager()
    liveness = Liveness(manager)
    liveness.at_normal_priority("no SCHED_FIFO")
    for index in range(READY_AFTER_TICKS):
        assert "READY=1" not in manager
        liveness.ticked((index + 1,), index < on_time, 0)
    told = f"STATUS={on_time} of the first {READY_AFTER_TICKS} ticks were on time: no SCHED_FIFO"
    assert manager[1:] == [told, "READY=1"]


def test_loops_that_never_keep_time_at_a_real_time_priority_are_never_ready():
    manager = Manager()
    liveness = Liveness(manager)
    for step in range(10 * READY_AFTER_TICKS):
        liveness.ticked((step,), step % READY_AFTER_TICKS != 0, step * ALIVE_EVERY_NS)
    assert "READY=1" not in manager
    assert "WATCHDOG=1" in manager


@pytest.mark.parametrize("stopped", [None, 0, 1])
def test_the_watchdog_is_fed_only_while_every_loop_advances(stopped):
    manager = Manager()
    liveness = Liveness(manager)
    for step in range(1, 5):
        indices = tuple(7 if loop == stopped else step for loop in range(2))
        liveness.ticked(indices, True, step * ALIVE_EVERY_NS)
    assert manager.count("WATCHDOG=1") == (0 if stopped is not None else 3)
