# SPDX-License-Identifier: Apache-2.0
"""Of the steps since the last tick, the one that was latest is told, with the time that the world stood still."""

from sim_bridge.worst_lag import Lag, WorstLag

MS = 1_000_000


def step(due_ms, late_ms, took_ms=0.5):
    began_ns = int((due_ms + late_ms) * MS)
    return Lag(due_ms * MS, began_ns, began_ns + int(took_ms * MS))


def test_the_step_that_was_done_latest_after_it_was_due_is_told_once():
    lag = WorstLag()
    for one in (step(1, 0), step(2, 3), step(3, 0, 3.2), step(4, 2)):
        lag.note(one, 0)
    assert lag.take(0) == step(2, 3)
    lag.note(step(5, 1), 0)
    assert lag.take(0) == step(5, 1)


def test_a_world_that_stood_still_was_late_for_that_too():
    lag = WorstLag()
    lag.note(step(1, 0), 0)
    lag.note(step(2, 8), 0)
    lag.note(step(6, 5), 3 * MS)
    worst = lag.take(3 * MS)
    assert worst == step(2, 8)
    lag.note(step(7, 4.8), 3 * MS)
    lag.note(step(12, 4.8), 7 * MS)
    assert lag.take(7 * MS) == step(12, 4.8)._replace(due_ns=8 * MS)
