# SPDX-License-Identifier: Apache-2.0
"""The bench of the real-time executor counts what the ticks say."""

import shutil

import pytest

from runtime.cli import bench_rt
from runtime.executors.tick import ENTRY, Tick, manifest_of
from runtime.tasks import Loop


class Executor:
    """Has the manifest of one loop without tasks."""

    manifest = manifest_of((Loop("fast", 1_000_000, 500_000, 80, (), (), (), ()),))


def datagram(index, skipped=0, compute_us=10, wake_us=1, cpu_us=10):
    tick = Tick("/ugv/tick/fast", {"received": 0})
    tick.index, tick.skipped = index, skipped
    tick.compute_ns, tick.wake_latency_ns, tick.cpu_ns = compute_us * 1000, wake_us * 1000, cpu_us * 1000
    body = tick.to_bytes()
    return ENTRY.pack(0, len(body)) + body


def test_standing_up_is_not_counted_and_an_overrun_is_our_own_if_we_computed_too_long():
    sink = bench_rt.TickSink()
    ticks = [
        datagram(10, compute_us=9000),
        datagram(1500, wake_us=5),
        datagram(1501, compute_us=1200, wake_us=7, cpu_us=1150),
        datagram(1503, skipped=1),
        datagram(1507, skipped=3, compute_us=1300),
        datagram(1509, skipped=1),
    ]
    for tick in ticks:
        sink.write(tick)
    found = bench_rt._measured(Executor, sink, "fast", 1_000_000)
    assert found.wake_us == [5.0, 7.0, 1.0, 1.0, 1.0]
    assert found.compute_us == [10.0, 1200.0, 10.0, 1300.0, 10.0]
    assert (found.skipped, found.own) == (5, 1)


def test_the_real_tasks_run_on_the_wall_clock_and_the_table_names_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(bench_rt, "RATES_HZ", (500,))
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    bench_rt.measure(slices=1, seconds=0.5)
    text = capsys.readouterr().out
    assert "500 Hz, idle: medians over 1 slices" in text
    assert "WBC with its tasks, MPC beside" in text
    assert "cyclictest is not installed" in text
    assert "stress-ng is not installed" in text


def test_without_cyclictest_there_is_no_reference(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    assert bench_rt.cyclictest(2_000_000, 1.0, 80) == []
    assert bench_rt._median([]) is None
    assert bench_rt._median([[]]) is None
    assert bench_rt._median([[1.0, 3.0], [5.0, 5.0]])[0] == pytest.approx(3.5)
