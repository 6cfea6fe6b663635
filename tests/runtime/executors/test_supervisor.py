# SPDX-License-Identifier: Apache-2.0
"""Processes are kept running as a service manager does it: fake ones, whose ends the test chooses."""

import pytest

from runtime.executors.supervisor import Service, Supervisor

READY_WITHIN_S, SILENT_FOR_S, PAUSE_S, STARTS, WITHIN_S = 60.0, 2.0, 1.0, 5, 60.0
NAMES = ("recorder", "link", "control")


class FakePool:
    """Runs nothing, and notes what it was asked to do."""

    def __init__(self):
        self.orders, self.ended, self._words = [], {}, {}

    def start(self, name, command):
        self.orders.append(("start", name))
        self._words[name] = []

    def stop(self, name, within_s=10.0):
        self.orders.append(("stop", name))
        return self.ended.pop(name, 0)

    def told(self, name):
        words, self._words[name] = self._words[name], []
        return words

    def tells(self, name, *words):
        self._words[name] += words

    @property
    def started(self):
        return [name for order, name in self.orders if order == "start"]


class Rig:
    """A supervisor of three services, its pool, what it said, and the time."""

    def __init__(self):
        self.pool, self.said, self.now_s = FakePool(), [], 1000.0
        services = [
            Service(name, ["run", name], READY_WITHIN_S, SILENT_FOR_S, PAUSE_S, STARTS, WITHIN_S) for name in NAMES
        ]
        self.supervisor = Supervisor(services, self.pool, self.said.append)

    def look(self, after_s=0.1):
        self.now_s += after_s
        self.supervisor.look(self.now_s)

    def all_ready(self):
        for name in NAMES:
            self.look()
            self.pool.tells(name, "STATUS=all is well", "READY=1")
        self.look()

    def end(self, name, code):
        self.pool.ended[name] = code
        self.look()

    def alive(self, *names):
        for name in names:
            self.pool.tells(name, "WATCHDOG=1")


@pytest.fixture
def rig():
    return Rig()


def test_each_starts_when_the_one_before_is_ready(rig):
    for _ in range(5):
        rig.look()
    assert rig.pool.started == ["recorder"]
    rig.pool.tells("recorder", "READY=1")
    rig.look()
    assert rig.pool.started == ["recorder", "link"]
    rig.pool.tells("link", "STATUS=not yet")
    rig.look()
    assert rig.pool.started == ["recorder", "link"]
    rig.pool.tells("link", "READY=1")
    rig.look()
    assert rig.pool.started == list(NAMES)
    assert "the process link is ready" in rig.said


def test_one_that_fails_at_its_start_forbids_none_behind_it(rig):
    rig.look()
    rig.end("recorder", 2)
    assert rig.pool.started == ["recorder", "link"]


def test_one_that_never_gets_ready_is_ended_and_forbids_none_behind_it(rig):
    rig.look()
    rig.look(READY_WITHIN_S + 1)
    assert rig.pool.orders == [("start", "recorder"), ("stop", "recorder"), ("start", "link")]
    assert "the process recorder is not ready after 60 s; it is to be started again in 1 s" in rig.said


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("code", [0, 1, -9])
def test_one_that_ends_is_started_again_after_its_pause_and_the_others_go_on(rig, name, code):
    rig.all_ready()
    rig.end(name, code)
    assert rig.pool.started == list(NAMES)
    rig.alive(*set(NAMES) - {name})
    rig.look(PAUSE_S)
    assert rig.pool.started == [*NAMES, name]
    assert [order for order in rig.pool.orders if order[0] == "stop"] == [("stop", name)]
    how = "was killed by signal 9" if code < 0 else f"ended with code {code}"
    assert f"the process {name} {how}; it is to be started again in 1 s" in rig.said


def test_one_that_falls_silent_is_ended_and_started_again(rig):
    rig.all_ready()
    for _ in range(10):
        rig.alive("recorder", "link", "control")
        rig.look(0.5)
    assert rig.pool.started == list(NAMES)
    for _ in range(10):
        rig.alive("recorder", "link")
        rig.look(0.5)
    assert rig.pool.orders[3:] == [("stop", "control"), ("start", "control")]
    assert "the process control has not said for 2 s that it is alive; it is to be started again in 1 s" in rig.said


def test_one_that_ends_too_often_is_given_up_in_one_sentence_and_the_others_go_on(rig):
    rig.all_ready()
    for _ in range(30):
        if "recorder" in rig.pool.started[-1:] or len(rig.pool.started) == len(NAMES):
            rig.pool.ended.setdefault("recorder", 1)
        rig.alive("link", "control")
        rig.look(PAUSE_S)
        if rig.supervisor.given_up:
            rig.pool.ended.clear()
    assert rig.pool.started.count("recorder") == STARTS
    assert rig.supervisor.given_up == {"recorder"}
    assert rig.said.count("the process recorder is given up after 5 starts within 60 s") == 1
    assert ("stop", "control") not in rig.pool.orders
    assert ("stop", "link") not in rig.pool.orders


def test_ends_far_apart_are_no_reason_to_give_up(rig):
    rig.all_ready()
    for _ in range(3 * STARTS):
        rig.end("recorder", 1)
        rig.alive("link", "control")
        rig.look(PAUSE_S)
        rig.pool.tells("recorder", "READY=1")
        for _ in range(int(WITHIN_S / (STARTS - 1))):
            rig.alive(*NAMES)
            rig.look(1.0)
    assert rig.supervisor.given_up == set()
    assert rig.pool.started.count("recorder") == 1 + 3 * STARTS


def test_they_stop_in_the_opposite_order_also_after_one_was_started_again(rig):
    rig.all_ready()
    rig.end("recorder", -9)
    rig.look(PAUSE_S)
    del rig.pool.orders[:]
    rig.supervisor.stop()
    assert rig.pool.orders == [("stop", "control"), ("stop", "link"), ("stop", "recorder")]
    rig.supervisor.stop()
    assert len(rig.pool.orders) == 3, "each is stopped once"


def test_what_does_not_run_is_not_stopped(rig):
    rig.look()
    rig.supervisor.stop()
    assert rig.pool.orders == [("start", "recorder"), ("stop", "recorder")]
