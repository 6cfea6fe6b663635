# SPDX-License-Identifier: Apache-2.0
"""`ugv bench rt`: how late the loops wake, how long they compute, and how often they overrun, on the wall clock.

The real tasks are given the inputs of a recorded walk, MPC beside WBC, each a thread of the real-time executor.
Between such slices come slices of the same loops without tasks, and of cyclictest where it is installed: all three see
the same machine in the same minutes, and their ratios say what is ours. It is measured idle and, where stress-ng is
installed, under its load.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

RATES_HZ = (500, 1000)
SLICES, SLICE_S, LIVE_S = 12, 5.0, 20.0
QUANTILES = (50.0, 99.0, 99.9)
STANDING_UP_S = 1.5
"""The beginning of a slice, in which the robot does not walk yet, is not counted."""
START_AFTER_NS = 200_000_000


class Slice(NamedTuple):
    """One loop over some seconds.

    Attributes:
        wake_us: wake latency of each tick.
        compute_us: wall time of its tasks.
        skipped: periods skipped.
        own: ticks before a skip whose tasks themselves computed for longer than a period, interruptions left out.
    """

    wake_us: list[float]
    compute_us: list[float]
    skipped: int
    own: int


@dataclass
class TickSink:
    """Keeps the tick records of the datagrams."""

    ticks: list[bytes] = field(default_factory=list)
    dropped: int = 0

    def write(self, datagram: bytes) -> None:
        """Keep the first entry."""
        self.ticks.append(datagram[:128])


def slice_of(walk: Path, seconds: float, bare: bool) -> Slice:
    """The fast loop over some seconds of a recorded walk, the other loop beside it; `bare` leaves out every task."""
    import dataclasses

    from runtime.executors.realtime import RealTime
    from runtime.executors.recorded_ports import RecordedPort, moved_in_time
    from runtime.recording.log import Log
    from runtime.robots import assemble

    log, sink = Log(walk), TickSink()
    start_ns = time.monotonic_ns() + START_AFTER_NS
    loops = assemble(log.robot, log.config)
    ports: dict[str, RecordedPort] = {}
    for loop in loops:
        periods = int((STANDING_UP_S + seconds) * 1e9) // loop.period_ns
        for record in loop.port_inputs:
            signal = log.read_signal(record.topic)
            bodies = moved_in_time(record, signal.values, start_ns)
            numbered = dict(zip((signal.log_ns // loop.period_ns).tolist(), bodies, strict=True))
            ports[record.topic] = RecordedPort(numbered, periods, start_ns, loop.period_ns, lambda: executor.stop())
    if bare:
        loops = tuple(dataclasses.replace(loop, schedule=(), port_outputs=()) for loop in loops)
    outputs = {record.topic: Nowhere() for loop in loops for record in loop.port_outputs}
    executor = RealTime(loops, ports, outputs, sink)
    executor.run(start_ns)
    return _measured(executor, sink, loops[0].name, loops[0].period_ns)


class Nowhere:
    """An output port that sends nothing."""

    def write(self, record: Any, now_ns: int) -> None:
        """Take the record."""


def _measured(executor: Any, sink: TickSink, loop: str, period_ns: int) -> Slice:
    """What the ticks of one loop say, but for those of standing up."""
    from runtime.executors.tick import TICK_TOPIC_PREFIX, entries

    channel = executor.manifest.of_topic(TICK_TOPIC_PREFIX + loop)
    tick, wake, compute, skipped, own = channel.record.like(), [], [], 0, 0
    for datagram in sink.ticks:
        number, body = next(entries(datagram))
        if number != channel.number:
            continue
        before_ns = tick.cpu_ns
        tick.load(body)
        if tick.index * period_ns < STANDING_UP_S * 1e9:
            continue
        wake.append(tick.wake_latency_ns / 1e3)
        compute.append(tick.compute_ns / 1e3)
        skipped += tick.skipped
        own += bool(tick.skipped) and before_ns > period_ns
    return Slice(wake, compute, skipped, own)


def cyclictest(period_ns: int, seconds: float, priority: int) -> list[float]:
    """Wake latencies that cyclictest sees, us; none where it is not installed or may not run."""
    if shutil.which("cyclictest") is None:
        return []
    with tempfile.TemporaryDirectory(prefix="ugv-bench-") as parent:
        found = Path(parent) / "latencies.json"
        command = ["cyclictest", "-q", "-m", "-t1", f"-p{priority}", f"-i{period_ns // 1000}", "-h20000"]
        command += [f"-D{max(1, round(seconds))}", f"--json={found}"]
        if subprocess.run(command, capture_output=True).returncode != 0 or not found.is_file():
            return []
        histogram = json.loads(found.read_text())["thread"]["0"]["histogram"]
    return [float(latency) for latency, count in histogram.items() for _ in range(count)]


@contextlib.contextmanager
def load(wanted: bool) -> Iterator[None]:
    """Every processor busy with stress-ng, if wanted."""
    if not wanted:
        yield
        return
    stress = subprocess.Popen(
        ["stress-ng", "--cpu", str(os.cpu_count() or 1), "--vm", "1", "--vm-bytes", "128M", "--quiet"]
    )
    try:
        yield
    finally:
        stress.terminate()
        stress.wait()


def measure(slices: int = SLICES, seconds: float = SLICE_S) -> None:
    """Measure at each rate, idle and loaded, and print."""
    from runtime.cli.bench import SCENARIO, recorded
    from runtime.cli.console import progress_bar

    loads = [False, True] if shutil.which("stress-ng") else [False]
    for rate_hz in RATES_HZ:
        with recorded(SCENARIO, STANDING_UP_S + seconds + 0.5, {"loops.wbc_hz": str(rate_hz)}) as walk:
            for loaded in loads:
                ours: list[Slice] = []
                bare: list[Slice] = []
                reference: list[list[float]] = []
                with progress_bar(f"{rate_hz} Hz, {'loaded' if loaded else 'idle'}") as progress, load(loaded):
                    for number in range(slices):
                        ours.append(slice_of(walk, seconds, bare=False))
                        bare.append(slice_of(walk, seconds, bare=True))
                        reference.append(cyclictest(10**9 // rate_hz, seconds, priority=80))
                        progress(number + 1, slices)
                _print(rate_hz, loaded, ours, bare, [latencies for latencies in reference if latencies])
    for tool in ("cyclictest", "stress-ng"):
        if shutil.which(tool) is None:
            print(f"{tool} is not installed, so what it would show is missing (Debian: rt-tests, stress-ng)")


def measure_live(seconds: float = LIVE_S) -> None:
    """A walk in real time, every process of the robot running, and print how late each woke and how old the IMU was."""
    import numpy as np

    from runtime.cli.bench import ROBOT, SCENARIO
    from runtime.cli.console import print_table, progress_bar
    from runtime.cli.sil import simulate_live
    from runtime.executors.tick import TICK_TOPIC_PREFIX
    from runtime.recording.log import Log
    from runtime.recording.run_data import BODY_STATE

    with tempfile.TemporaryDirectory(prefix="ugv-bench-") as parent:
        out = Path(parent) / "live"
        out.mkdir()
        with progress_bar(f"{SCENARIO} in real time") as progress:
            summary = simulate_live(ROBOT, SCENARIO, out=out, until_s=seconds, progress=progress)
        log = Log(out)
        rows = []
        for loop in ("wbc", "mpc", "link", "sim"):
            ticks = log.read_signal(TICK_TOPIC_PREFIX + loop).values
            wake = np.percentile(ticks["wake_latency_ns"] * 1e-3, QUANTILES)
            compute = np.percentile(ticks["compute_ns"] * 1e-3, QUANTILES[:2])
            rows.append((loop, *wake, *compute, 100.0 * ticks["skipped"].sum() / (ticks["index"][-1] + 1)))
        age = np.percentile(log.read_signal(BODY_STATE).values["imu_age_ns"] * 1e-3, QUANTILES)
    print_table(
        f"{SCENARIO} in real time, {summary['sim_time_s']:.0f} s, us",
        ("", "wake p50", "p99", "p99.9", "compute p50", "p99", "skipped %"),
        rows,
    )
    print_table("age of the inertial sample that the estimator used, us", ("", "p50", "p99", "p99.9"), [("IMU", *age)])


def _print(
    rate_hz: int, loaded: bool, ours: Sequence[Slice], bare: Sequence[Slice], reference: Sequence[Sequence[float]]
) -> None:
    from runtime.cli.console import print_table

    base = _median(reference)
    rows = [
        ("WBC with its tasks, MPC beside", *_wake(ours, base), *_compute(ours), *_overruns(ours)),
        ("the same loops without tasks", *_wake(bare, base), *_compute(bare), *_overruns(bare)),
    ]
    if base is not None:
        rows.append(("cyclictest", *base, 1.0, None, None, None, None))
    print_table(
        f"{rate_hz} Hz, {'every processor loaded' if loaded else 'idle'}: medians over {len(ours)} slices, us",
        ("", "wake p50", "p99", "p99.9", "p99 to cyclictest", "compute p50", "p99", "skipped %", "by own compute"),
        rows,
    )


def _median(samples: Sequence[Sequence[float]]) -> tuple[float, float, float] | None:
    """Medians over slices of the 50th, 99th and 99.9th percentile; slices in which nothing ran are left out."""
    import numpy as np

    samples = [one for one in samples if one]
    if not samples:
        return None
    p50, p99, p999 = np.median([np.percentile(one, (50.0, 99.0, 99.9)) for one in samples], axis=0)
    return float(p50), float(p99), float(p999)


def _wake(slices: Sequence[Slice], base: tuple[float, float, float] | None) -> tuple[float | None, ...]:
    wake = _median([one.wake_us for one in slices])
    if wake is None:
        return None, None, None, None
    return (*wake, None if base is None else wake[1] / base[1])


def _compute(slices: Sequence[Slice]) -> tuple[float | None, float | None]:
    compute = _median([one.compute_us for one in slices])
    return (None, None) if compute is None else compute[:2]


def _overruns(slices: Sequence[Slice]) -> tuple[float, int]:
    """Median share of skipped periods, and how many the tasks themselves caused in all."""
    import numpy as np

    share = [100.0 * one.skipped / max(1, one.skipped + len(one.wake_us)) for one in slices]
    return float(np.median(share)), sum(one.own for one in slices)
