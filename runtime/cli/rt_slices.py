# SPDX-License-Identifier: Apache-2.0
"""Short stretches of real time to be compared: loops on a recorded walk, the same loops without tasks, cyclictest."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.cli.overruns import Slice
from runtime.executors.processes import how_it_ended

if TYPE_CHECKING:
    from runtime.executors.realtime import RealTime
    from runtime.tasks import Loop

STANDING_UP_S = 1.5
"""The beginning of a slice, in which the robot does not walk yet, is not counted."""
START_AFTER_NS = 1_000_000_000
"""Time to move the recorded inputs to the present."""


@dataclass
class TickSink:
    """Keeps the tick records of the datagrams, and when they came."""

    ticks: list[tuple[bytes, int]] = field(default_factory=list)
    dropped: int = 0

    def write(self, datagram: bytes) -> None:
        """Keep the first entry."""
        self.ticks.append((datagram[:128], time.monotonic_ns()))


class Nowhere:
    """An output port that sends nothing."""

    def write(self, record: Any, now_ns: int) -> None:
        """Take the record."""


class Walk:
    """A recorded walk, whose inputs can be given to its loops again and again.

    Args:
        run_directory: of the log.
        seconds: to give at most, after standing up.
        say: told what the system did not grant the loops.

    Attributes:
        period_ns: of the fast loop.
    """

    def __init__(self, run_directory: Path, seconds: float, say: Callable[[str], None]) -> None:
        from runtime.recording.log import Log
        from runtime.robots import assemble

        log = Log(run_directory)
        self._robot, self._config = log.robot, log.config
        self._seconds, self._say = STANDING_UP_S + seconds, say
        loops = assemble(log.robot, log.config)
        self.period_ns = loops[0].period_ns
        self._bare = tuple(dataclasses.replace(loop, schedule=(), port_outputs=(), last_outputs=()) for loop in loops)
        self._inputs = {
            record.topic: (loop.period_ns, record, log.read_signal(record.topic))
            for loop in loops
            for record in loop.port_inputs
        }

    def slice(self, bare: bool, wake_early_us: int) -> Slice:
        """Run the loops in real time and say how the fast one went.

        Args:
            bare: leaves out every task.
            wake_early_us: how long before its release the fast loop is woken.
        """
        from runtime.executors.realtime import RealTime
        from runtime.executors.recorded_ports import RecordedPort, moved_in_time
        from runtime.robots import assemble

        loops, sink = self._bare if bare else assemble(self._robot, self._config), TickSink()
        start_ns = time.monotonic_ns() + START_AFTER_NS
        ports = {}
        for topic, (period_ns, record, signal) in self._inputs.items():
            bodies = moved_in_time(record, signal.values, start_ns)
            numbered = dict(zip((signal.log_ns // period_ns).tolist(), bodies, strict=True))
            periods = int(self._seconds * 1e9) // period_ns
            ports[topic] = RecordedPort(numbered, periods, start_ns, period_ns, lambda: executor.stop())
        outputs = {record.topic: Nowhere() for loop in loops for record in loop.port_outputs}
        executor = RealTime(loops, ports, outputs, sink, wake_early_us=wake_early_us, say=self._say)
        executor.run(start_ns)
        return slice_of(executor, sink, loops[0])


def slice_of(executor: RealTime, sink: TickSink, loop: Loop) -> Slice:
    """How the ticks of one loop went, but for those of standing up."""
    from runtime.executors.tick import TICK_TOPIC_PREFIX, entries, tick_record

    channel = executor.manifest.of_topic(TICK_TOPIC_PREFIX + loop.name)
    tick, rows = tick_record(loop), []
    for datagram, logged_ns in sink.ticks:
        number, body = next(entries(datagram))
        if number == channel.number:
            tick.load(body)
            busy_ns = logged_ns - tick.now_ns
            rows.append((tick.index, tick.wake_latency_ns, busy_ns, tick.skipped, tick.compute_ns))
    table = np.array(rows, np.int64).reshape(-1, 5)
    return Slice(*table[table[:, 0] * loop.period_ns >= STANDING_UP_S * 1e9].T)


def cyclictest(period_ns: int, seconds: float, priority: int, say: Callable[[str], None]) -> list[float]:
    """Wake latencies that cyclictest sees, us; none where it is not installed, or gives none, which is told why."""
    if shutil.which("cyclictest") is None:
        return []
    with tempfile.TemporaryDirectory(prefix="ugv-bench-") as parent:
        found = Path(parent) / "latencies.json"
        command = ["cyclictest", "-q", "-m", "-t1", f"-p{priority}", f"-i{period_ns // 1000}", "-h20000"]
        command += [f"-D{max(1, round(seconds))}", f"--json={found}"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0 or not found.is_file():
            words = (done.stderr or done.stdout).split()
            say(f"cyclictest {how_it_ended(done.returncode)}: {' '.join(words) or 'it does not say why'}")
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
