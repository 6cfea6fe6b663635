# SPDX-License-Identifier: Apache-2.0
"""A fault is laid to the stall that the ticks show before it, and to none where there is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from runtime.recording import run_data
from runtime.recording.stalls import LOOKBACK_NS, fault_events
from runtime.signals import Fault, Mode

MS = 1_000_000
TICK = np.dtype(
    [("release_ns", "<i8"), ("wake_latency_ns", "<i8"), ("compute_ns", "<i8"), ("cpu_ns", "<i8"), ("skipped", "<u4")]
)
SAFETY = np.dtype([("mode", "u1"), ("fault", "<u4"), ("warning", "<u4")])


class Log:
    """A second of walking, with a fault and stalls."""

    def __init__(self, modes, stalls=()):
        times = np.arange(len(modes), dtype=np.int64) * 2 * MS
        safety = np.zeros(len(modes), SAFETY)
        safety["mode"] = modes
        safety["fault"] = np.where(safety["mode"] == Mode.DAMPED, Fault.STALE_MOTOR, 0)
        safety["warning"] = np.where(safety["mode"] == Mode.CROUCHING, Fault.STALE_IMU, 0)
        self.signals = {run_data.SAFETY: SimpleNamespace(log_ns=times, values=safety)}
        for loop in ("wbc", "sim"):
            ticks = np.zeros(len(modes), TICK)
            ticks["release_ns"] = times
            for name, row, wake_ms, compute_ms in stalls:
                if name == loop:
                    ticks["wake_latency_ns"][row], ticks["compute_ns"][row] = wake_ms * MS, compute_ms * MS
            self.signals[f"/ugv/tick/{loop}"] = SimpleNamespace(log_ns=times, values=ticks)
        self.channels = self.signals

    def read_signal(self, topic):
        return self.signals[topic]


def walk(*lost):
    return [Mode.ACTIVE] * 400 + list(lost) + [Mode.DAMPED] * 50


@pytest.mark.parametrize(("wake_ms", "compute_ms"), [(12, 0), (0, 12), (6, 6)])
def test_the_longest_stall_shortly_before_the_fault_explains_it(wake_ms, compute_ms):
    (event,) = fault_events(Log(walk(), [("sim", 398, wake_ms, compute_ms), ("wbc", 390, 6, 0)]), 5 * MS)
    assert event.at_ns == 800 * MS
    assert event.fault == Fault.STALE_MOTOR
    assert (event.stall.loop, event.stall.length_ns) == ("sim", 12 * MS)


@pytest.mark.parametrize(
    "stalls",
    [[], [("sim", 398, 4, 0)], [("sim", 399 - (LOOKBACK_NS // MS + 20) // 2, 12, 0)], [("sim", 401, 12, 0)]],
    ids=["none", "too short", "too early", "after it"],
)
def test_a_fault_without_a_stall_before_it_has_none(stalls):
    (event,) = fault_events(Log(walk(), stalls), 5 * MS)
    assert event.stall is None


def with_overruns(own_ms):
    """Four overruns in a row before the fault, of 3 ms each, of which the step itself computed some."""
    log = Log(walk())
    ticks = log.signals["/ugv/tick/wbc"].values
    rows = slice(390, 394)
    ticks["compute_ns"][rows], ticks["cpu_ns"][rows] = 3 * MS, int(own_ms * MS)
    ticks["skipped"][391:395] = 1
    return log


def test_overruns_in_a_row_for_which_the_machine_took_the_time_are_one_stall():
    (event,) = fault_events(with_overruns(own_ms=0.5), 5 * MS)
    assert (event.stall.loop, event.stall.length_ns) == ("wbc", 10 * MS)


def test_what_a_loop_computed_itself_is_no_stall():
    (event,) = fault_events(with_overruns(own_ms=2.5), 5 * MS)
    assert event.stall is None


def test_a_crouch_and_the_damping_after_it_are_one_event():
    (event,) = fault_events(Log(walk(*[Mode.CROUCHING] * 20)), 5 * MS)
    assert event.fault == Fault.STALE_IMU
    assert event.at_ns == 800 * MS


def test_a_robot_that_sits_down_lost_nothing():
    assert fault_events(Log([Mode.ACTIVE] * 10 + [Mode.STANDING] * 10 + [Mode.STANDBY] * 10), 5 * MS) == []
