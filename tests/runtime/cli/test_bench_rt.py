# SPDX-License-Identifier: Apache-2.0
"""The bench of the real-time executor counts what the ticks say."""

import shutil

import pytest

from runtime.cli import bench_rt, rt_slices
from runtime.executors.tick import ENTRY, Tick, manifest_of
from runtime.tasks import Loop

LOOP = Loop("fast", 1_000_000, 500_000, 80, (), (), (), ())


class Executor:
    """Has the manifest of one loop without tasks."""

    manifest = manifest_of((LOOP,))


def datagram(index, now_us, skipped=0, wake_us=1):
    tick = Tick("/ugv/tick/fast", {"received": 0})
    tick.index, tick.skipped = index, skipped
    tick.now_ns, tick.wake_latency_ns = now_us * 1000, wake_us * 1000
    body = tick.to_bytes()
    return ENTRY.pack(0, len(body)) + body


def test_a_tick_is_busy_from_waking_until_it_is_logged_and_standing_up_is_not_counted():
    sink = rt_slices.TickSink()
    sink.ticks = [
        (datagram(10, now_us=10_000), 19_000_000),
        (datagram(1500, now_us=1_500_005, wake_us=5), 1_500_205_000),
        (datagram(1502, now_us=1_502_001, skipped=1), 1_502_031_000),
    ]
    found = rt_slices.slice_of(Executor, sink, LOOP)
    assert found.index.tolist() == [1500, 1502]
    assert found.wake_ns.tolist() == [5000, 1000]
    assert found.busy_ns.tolist() == [200_000, 30_000]
    assert found.skipped.tolist() == [0, 1]


def test_the_real_tasks_run_on_the_wall_clock_and_the_table_names_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(bench_rt, "RATES_HZ", (500,))
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    bench_rt.measure(slices=1, seconds=0.5)
    text = capsys.readouterr().out
    assert "500 Hz, idle: medians over 1 slices" in text
    assert "with tasks" in text
    assert "cyclictest is not installed" in text
    assert "stress-ng is not installed" in text


def test_without_cyclictest_there_is_no_reference(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    assert rt_slices.cyclictest(2_000_000, 1.0, 80) == []
    assert bench_rt.medians([]) is None
    assert bench_rt.medians([[]]) is None
    assert bench_rt.medians([[1.0, 3.0], [5.0, 5.0]])[0] == pytest.approx(3.5)
