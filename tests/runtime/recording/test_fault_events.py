# SPDX-License-Identifier: Apache-2.0
"""A fault is laid to stalls that fill its own bound in the ticks before it, and to none where they do not."""

from types import SimpleNamespace

import numpy as np
import pytest

from runtime.executors.tick import Tick
from runtime.recording import run_data
from runtime.recording.fault_events import SlowTicks, fault_events, judged, taking_power
from runtime.recording.stalls import Stall, StallBound
from runtime.signals import Fault, Mode

MS = 1_000_000
AT_NS = 800 * MS
TICK = Tick("", {"received": 1}).dtype
SAFETY = np.dtype([("stamp_ns", "<i8"), ("mode", "u1"), ("fault", "<u4"), ("warning", "<u4"), ("halt", "<u4")])
IMU = StallBound(Fault.STALE_IMU, ("link", "sim"), 16 * MS, 20 * MS)
MOTOR = StallBound(Fault.STALE_MOTOR, ("sim",), 6 * MS, 10 * MS)
BOUNDS = (IMU, MOTOR)


def ticks_of(count, period_ms=2):
    ticks = np.zeros(count, TICK)
    ticks["index"] = np.arange(count)
    ticks["release_ns"] = ticks["index"] * period_ms * MS
    return ticks


class Log:
    """A second of walking, with a fault and stalls."""

    def __init__(self, modes, stalls=(), halts=(), computing=""):
        times = np.arange(len(modes), dtype=np.int64) * 2 * MS
        safety = np.zeros(len(modes), SAFETY)
        safety["stamp_ns"], safety["mode"] = times, modes
        for row, fault in halts:
            safety["halt"][row] = fault
        safety["fault"] = np.where(safety["mode"] == Mode.DAMPED, Fault.STALE_MOTOR, 0)
        safety["warning"] = np.where(safety["mode"] == Mode.CROUCHING, Fault.STALE_IMU, 0)
        self.signals = {run_data.SAFETY: SimpleNamespace(log_ns=times, values=safety)}
        for loop in ("wbc", "sim"):
            ticks = ticks_of(len(modes))
            for name, row, wake_ms, compute_ms in stalls:
                if name == loop:
                    ticks["wake_latency_ns"][row], ticks["compute_ns"][row] = wake_ms * MS, compute_ms * MS
                    if name == computing:
                        ticks["cpu_ns"][row] = compute_ms * MS
            self.signals[f"/ugv/tick/{loop}"] = SimpleNamespace(log_ns=times, values=ticks)
        self.channels = self.signals

    def read_signals(self, topics):
        return {topic: self.signals[topic] for topic in topics}


def walk(*others):
    return [Mode.ACTIVE] * 400 + list(others) + [Mode.DAMPED] * 50


def lost(fault, bounds, stalls):
    return judged(fault, taking_power(fault), AT_NS, bounds, stalls)


@pytest.mark.parametrize(("wake_ms", "compute_ms"), [(8, 0), (0, 8), (4, 4)])
def test_a_stall_beyond_the_bound_explains_the_fault(wake_ms, compute_ms):
    (event,), _ = fault_events(Log(walk(), [("sim", 396, wake_ms, compute_ms)]), BOUNDS)
    assert event.at_ns == AT_NS
    assert event.fault == event.cause == Fault.STALE_MOTOR
    assert event.bound == MOTOR
    assert event.stall == Stall("sim", 792 * MS, 8 * MS)


@pytest.mark.parametrize(
    "stalls",
    [[], [("sim", 397, 6, 0)], [("sim", 300, 30, 0)], [("sim", 406, 30, 0)], [("wbc", 396, 30, 0)]],
    ids=["none", "no longer than the bound", "long before it", "after it", "of a loop that does not bring it"],
)
def test_a_fault_without_such_a_stall_before_it_is_not_explained(stalls):
    (event,), _ = fault_events(Log(walk(), stalls), BOUNDS)
    assert event.stall is None
    assert event.bound == MOTOR
    assert event.stalled_ns <= MOTOR.bound_ns


def test_a_fault_that_no_stall_makes_is_explained_by_none():
    event = lost(Fault.TILT, BOUNDS, [Stall("sim", AT_NS - 500 * MS, 500 * MS)])
    assert (event.cause, event.bound, event.stall) == (Fault.TILT, None, None)


def test_of_several_faults_each_that_takes_the_power_needs_its_stall():
    stalls = [Stall("sim", AT_NS - 10 * MS, 10 * MS)]
    both = lost(Fault.STALE_MOTOR | Fault.STALE_IMU, BOUNDS, stalls)
    assert (both.cause, both.stall) == (Fault.STALE_IMU, None), "10 of 16 ms"
    bridged = lost(Fault.STALE_MOTOR | Fault.NO_LEASE | Fault.LATE_FORCES, BOUNDS, stalls)
    assert bridged.cause == Fault.STALE_MOTOR
    assert bridged.stall is not None


def test_a_fault_with_several_bounds_is_explained_by_any():
    bounds = (MOTOR, StallBound(Fault.STALE_MOTOR, ("drive",), 40 * MS, 60 * MS))
    event = lost(Fault.STALE_MOTOR, bounds, [Stall("drive", AT_NS - 50 * MS, 50 * MS)])
    assert event.bound == bounds[1]
    assert event.stall == Stall("drive", AT_NS - 50 * MS, 50 * MS)


def test_a_crouch_and_the_damping_after_it_are_one_event():
    (event,), _ = fault_events(Log(walk(*[Mode.CROUCHING] * 20)), BOUNDS)
    assert event.fault == Fault.STALE_IMU
    assert event.at_ns == AT_NS


@pytest.mark.parametrize("before", [Mode.STANDBY, Mode.STANDING, Mode.ACTIVE])
def test_a_robot_is_damped_from_anywhere(before):
    (event,), _ = fault_events(Log([before] * 400 + [Mode.DAMPED] * 50), BOUNDS)
    assert (event.at_ns, event.fault) == (AT_NS, Fault.STALE_MOTOR)


def test_a_robot_that_sits_down_lost_nothing():
    assert fault_events(Log([Mode.ACTIVE] * 10 + [Mode.STANDING] * 10 + [Mode.STANDBY] * 10), BOUNDS) == ([], [])


def test_a_fault_that_has_a_standing_robot_stand_is_asked_for_its_own_stall():
    late = StallBound(Fault.LATE_LOOP, ("wbc",), 3 * MS, 12 * MS)
    halts = [(slice(100, 200), Fault.LATE_LOOP), (slice(150, 250), Fault.STALE_FORCES | Fault.LATE_LOOP)]
    _, pauses = fault_events(Log([Mode.ACTIVE] * 400, [("wbc", 98, 4, 0)], halts), [late])
    assert [(pause.at_ns, pause.fault, pause.stall is None) for pause in pauses] == [
        (200 * MS, Fault.LATE_LOOP, False),
        (300 * MS, Fault.STALE_FORCES, True),
    ]


def test_a_robot_on_its_way_that_a_fault_has_stand_pauses():
    late = StallBound(Fault.LATE_LOOP, ("wbc",), 3 * MS, 12 * MS)
    halts = [(slice(100, 200), Fault.LATE_LOOP), (300, Fault.LATE_LOOP | Fault.NO_LEASE), (410, Fault.NO_LEASE)]
    modes = [Mode.ACTIVE] * 400 + [Mode.STANDING] * 50
    losses, pauses = fault_events(Log(modes, [("wbc", 98, 4, 0)], halts), [late])
    assert losses == []
    assert [(pause.at_ns, pause.cause) for pause in pauses] == [
        (200 * MS, Fault.LATE_LOOP),
        (600 * MS, Fault.NO_LEASE),
    ]
    assert [pause.stall for pause in pauses] == [Stall("wbc", 196 * MS, 4 * MS), None]


LATE = StallBound(Fault.LATE_LOOP, ("wbc",), 3 * MS, 12 * MS)
PAUSED = {"halts": [(400, Fault.LATE_LOOP)], "computing": "wbc"}


def paused(need_ms, asked=None):
    """The pause of a robot of which a tick computed for 6 ms by its thread's clock, and needs so much again."""

    def needs(loop, from_ns, to_ns):
        if asked is not None:
            asked.append((loop, from_ns, to_ns))
        return {397: need_ms * MS} if loop == "wbc" else {}

    _, (pause,) = fault_events(Log([Mode.ACTIVE] * 450, [("wbc", 397, 0, 6)], **PAUSED), [LATE], needs)
    return pause


def test_a_tick_that_was_slow_but_not_for_what_it_computes_is_a_stall():
    asked = []
    pause = paused(1, asked)
    assert pause.stall == Stall("wbc", 794 * MS, 5 * MS)
    assert pause.slow == SlowTicks("wbc", 1, 6 * MS, 1 * MS)
    ((loop, from_ns, to_ns),) = asked
    assert (loop, to_ns) == ("wbc", AT_NS)
    assert from_ns <= AT_NS - LATE.within_ns, "the tick that was under way then, too"


@pytest.mark.parametrize("need_ms", [3, 6, 9])
def test_computing_that_is_slow_by_itself_is_so_again_and_explains_nothing(need_ms):
    pause = paused(need_ms)
    assert (pause.stall, pause.slow) == (None, None)
    assert pause.bound == LATE


def test_ticks_are_stepped_again_only_where_no_stall_was_seen():
    def needs(loop, from_ns, to_ns):
        raise AssertionError

    log = Log([Mode.ACTIVE] * 450, [("wbc", 397, 6, 0)], **PAUSED)
    _, (pause,) = fault_events(log, [LATE], needs)
    assert pause.stall == Stall("wbc", 794 * MS, 6 * MS)
    assert fault_events(Log(walk()), [LATE], needs)[0][0].stall is None, "one that no stall makes"
