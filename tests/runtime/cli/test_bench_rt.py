# SPDX-License-Identifier: Apache-2.0
"""The bench of the real-time executor counts what the ticks say."""

import contextlib
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from runtime import signals
from runtime.cli import bench, bench_rt, rt_slices, sil
from runtime.cli.main import main
from runtime.cli.overruns import Slice
from runtime.executors.tick import ENTRY, Tick, manifest_of, tick_record
from runtime.recording.bag import BagSink
from runtime.recording.setup import recording_setup
from runtime.tasks import Loop

LOOP = Loop("fast", 1_000_000, 500_000, 80, (), (), (), ())


class Executor:
    """Has the manifest of one loop without tasks."""

    manifest = manifest_of((LOOP,))


def datagram(index, now_us, skipped=0, wake_us=1, compute_us=2):
    tick = Tick("/ugv/tick/fast", {"received": 0})
    tick.index, tick.skipped = index, skipped
    tick.now_ns, tick.wake_latency_ns = now_us * 1000, wake_us * 1000
    tick.compute_ns = compute_us * 1000
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
    assert found.compute_ns.tolist() == [2000, 2000]


def test_the_real_tasks_run_on_the_wall_clock_and_the_table_names_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(bench_rt, "RATES_HZ", (500,))
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    found = bench_rt.measure(slices=1, seconds=0.5)
    text = capsys.readouterr().out
    assert "500 Hz, idle: medians over 1 slices" in text
    assert [claim.says.partition(":")[0] for claim in found] == ["500 Hz, idle"] * 3
    assert found[2].kept is None, "without a reference"
    assert all(row in text for row in ("with tasks", "without tasks", "woken at release"))
    assert "cyclictest is not installed" in text
    assert "stress-ng is not installed" in text


def never(sentence):
    raise AssertionError(sentence)


def stand_in(directory, monkeypatch, script):
    """Put a program called cyclictest first on the path."""
    program = directory / "cyclictest"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{directory}:{os.environ['PATH']}")


def test_a_cyclictest_that_is_refused_is_told_in_one_sentence(tmp_path, monkeypatch, capsys):
    stand_in(tmp_path, monkeypatch, "echo 'Unable to change scheduling policy!' >&2; echo 'be root' >&2; exit 1")
    said = []
    assert rt_slices.cyclictest(2_000_000, 1.0, 80, said.append) == []
    assert said == ["cyclictest ended with code 1: Unable to change scheduling policy! be root"]
    monkeypatch.setattr(bench_rt, "RATES_HZ", (500,))
    monkeypatch.setattr(bench_rt, "Walk", EmptyWalk)
    monkeypatch.setattr(bench, "recorded", lambda *_: contextlib.nullcontext(tmp_path))
    monkeypatch.setattr(bench_rt, "load", lambda loaded: contextlib.nullcontext())
    monkeypatch.setattr(bench_rt.shutil, "which", lambda tool: tool if tool == "cyclictest" else None)
    bench_rt.measure(slices=3, seconds=1.0)
    told = capsys.readouterr().out
    assert told.count(f"{said[0]}; so 3 slices have no reference") == 1
    assert told.count("the loops: no SCHED_FIFO") == 1


def test_what_cyclictest_sees_is_the_reference(tmp_path, monkeypatch):
    result = '{"thread": {"0": {"histogram": {"3": 2, "5": 1}}}}'
    script = f"""for option; do case $option in --json=*) echo '{result}' > "${{option#--json=}}" ;; esac; done"""
    stand_in(tmp_path, monkeypatch, script)
    assert rt_slices.cyclictest(2_000_000, 1.0, 80, never) == [3.0, 3.0, 5.0]


class EmptyWalk:
    """A walk of which no slice has a tick."""

    period_ns = 2_000_000

    def __init__(self, run_directory, seconds, say):
        say("no SCHED_FIFO")

    def slice(self, bare, wake_early_us):
        return rt_slices.slice_of(Executor, rt_slices.TickSink(), LOOP)


def entry(number, record):
    raw = record.to_bytes()
    return ENTRY.pack(number, len(raw)) + raw


class LiveRun:
    """Stands for a run in real time: its log has ticks with given latencies, and samples of a given age.

    Before the first sample it has the output of an estimator that has not begun.
    """

    def __init__(self, wake_us, age_us):
        self.wake_us, self.age_us, self.asked = wake_us, age_us, None

    def __call__(self, robot, scenario, out, until_s, progress):
        self.asked = until_s
        body = signals.BodyState("/ugv/body_state", {"foot": 4, "foot_xyz": 12, "foot_pair": 16})
        aged = body.like()
        aged.stamp_ns, aged.imu_age_ns = 1, self.age_us * 1000
        loops = [Loop(name, 1, 1, 80, (body,) if name == "wbc" else (), (), (), ()) for name in self.wake_us]
        manifest, sink = manifest_of(tuple(loops)), BagSink(out, recording_setup(loops, robot, "", 0))
        for loop in loops:
            tick = tick_record(loop)
            tick.index, tick.wake_latency_ns = 0, self.wake_us[loop.name] * 1000
            written = (tick, *((body, aged) if loop.port_inputs else ()))
            sink.write(b"".join(entry(manifest.of_topic(record.topic).number, record) for record in written))
        sink.close()
        return {"sim_time_s": until_s}


def test_a_run_in_real_time_shows_how_late_every_process_woke_and_how_old_the_samples_were(monkeypatch, capsys):
    run = LiveRun({"wbc": 11, "mpc": 22, "link": 33, "sim": 44}, age_us=555)
    monkeypatch.setattr(sil, "simulate_live", run)
    bench_rt.measure_live(seconds=7.0)
    text = capsys.readouterr().out
    assert run.asked == 7.0
    assert "in real time, 7 s, us" in text
    rows = {words[0]: words[1:] for words in (re.findall(r"[\w.]+", line) for line in text.splitlines()) if words}
    for name, wake_us in run.wake_us.items():
        assert {float(value) for value in rows[name][:3]} == {wake_us}, name
    assert {float(value) for value in rows["IMU"]} == {555}


def test_without_cyclictest_there_is_no_reference(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    assert rt_slices.cyclictest(2_000_000, 1.0, 80, never) == []


def slice_of(wake_us, compute_us):
    column = np.full(10, 1000)
    return Slice(np.arange(10), wake_us * column, 2 * compute_us * column, 0 * column, compute_us * column)


class Slow:
    """A walk whose ticks wake late, and compute for 321 us at each rate and load."""

    period_ns = 2_000_000

    def __init__(self, run_directory, seconds, say):
        pass

    def slice(self, bare, wake_early_us):
        return slice_of(*((5, 1) if bare else (40, 321)))


@pytest.mark.parametrize(("reference_us", "code"), [(20.0, 1), (30.0, 0), (None, 0)])
def test_compute_is_shown_at_each_rate_and_load_and_a_claim_that_is_not_kept_is_told_by_the_exit_code(
    tmp_path, monkeypatch, capsys, reference_us, code
):
    monkeypatch.setattr(bench_rt, "Walk", Slow)
    monkeypatch.setattr(bench_rt, "cyclictest", lambda *_: [] if reference_us is None else [reference_us] * 5)
    monkeypatch.setattr(bench, "recorded", lambda *_: contextlib.nullcontext(tmp_path))
    monkeypatch.setattr(bench_rt, "load", lambda loaded: contextlib.nullcontext())
    monkeypatch.setattr(bench_rt.shutil, "which", lambda tool: tool)
    monkeypatch.setattr(bench_rt, "measure_live", lambda: None)
    assert main(["bench", "rt", "--slices", "3"]) == code
    text = capsys.readouterr().out
    for rate_hz in (500, 1000):
        for load in ("idle", "every processor loaded"):
            assert text.count(f"{rate_hz} Hz, {load}: medians over 3 slices, us") == 2
            assert text.count(f"{rate_hz} Hz, {load}: no overrun by our own compute") == 1
    computed = [line for line in text.splitlines() if "with tasks" in line and line.count("321") == 3]
    assert len(computed) == 4
    assert text.count("NO") == (4 if code else 0)


def test_medians_are_over_twelve_slices_unless_it_is_said_otherwise(monkeypatch):
    asked = []
    monkeypatch.setattr(bench_rt, "run", lambda slices: asked.append(slices) or 0)
    assert main(["bench", "rt"]) == 0
    assert main(["bench", "rt", "--slices", "3"]) == 0
    assert asked == [12, 3]


def test_all_that_can_be_measured_is_measured_by_make_bench():
    rules = (Path(__file__).parents[3] / "Makefile").read_text()
    measured = re.findall(r"^\t\$\(BIN\)/ugv bench (\w+)", rules, re.MULTILINE)
    assert sorted(measured) == sorted((bench.REAL_TIME, *bench.PARTS))
