# SPDX-License-Identifier: Apache-2.0
"""Ticks of a log are stepped again, and their own computing is measured."""

import time

import pytest

from runtime.recording.log import Log
from runtime.recording.stepping_again import needed_ns

MS = 1_000_000


@pytest.fixture
def slow_at(toy, monkeypatch):
    """Makes loops whose fast one computes for 20 ms at a time of the log."""

    def loops(at_ns):
        made = toy.loops()
        (task, step) = (made[0].schedule[0].task, made[0].schedule[0].task.step)

        def slow(now_ns):
            if now_ns == at_ns:
                until_ns = time.thread_time_ns() + 20 * MS
                while time.thread_time_ns() < until_ns:
                    pass
            step(now_ns)

        monkeypatch.setattr(task, "step", slow)
        return made

    return loops


def test_a_tick_whose_tasks_compute_for_long_needs_that_again(recorded, slow_at):
    needed = needed_ns(Log(recorded), slow_at(300 * MS), "fast", 280 * MS, 320 * MS)
    assert needed[150] >= 20 * MS
    assert set(range(140, 161)) <= needed.keys()
    others = sorted(spent for index, spent in needed.items() if index != 150)
    assert others[len(others) // 2] < 20 * MS


def test_of_a_loop_that_cannot_be_stepped_nothing_is_known(recorded, toy):
    assert needed_ns(Log(recorded), toy.loops(), "sim", 0, 400 * MS) == {}


def test_the_other_loops_are_not_stepped(recorded, toy):
    needed = needed_ns(Log(recorded), toy.loops(), "slow", 200 * MS, 400 * MS)
    assert set(needed) == set(range(21))
