# SPDX-License-Identifier: Apache-2.0
"""`ugv run` without `--process`: what control is made of; a recorder that is killed comes back, and control goes on."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from drivers.unix_hub import UnixHub
from runtime.cli.fitness.scheduling import try_priority
from runtime.executors.runtime_directory import runtime_directory
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.executors.tick_stream import LOOK_AGAIN_NS, OBSERVER_SOCKET, TickListener
from runtime.recording.log import Log
from runtime.robots import assembled, load_configuration
from sim_bridge.free_port import free_port
from sim_bridge.tick_mirror import TickMirror

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
TICK = TICK_TOPIC_PREFIX + "wbc"
TICKS_BESIDE = 100
RECORDED_NS = 10 * LOOK_AGAIN_NS
"""So long a recorder is given to hear of control."""


class Ticks:
    """The ticks of control, one at a time."""

    def __init__(self, directory, config):
        self._listener, self._waiting = TickListener(directory / OBSERVER_SOCKET), None
        self._mirror = TickMirror(assembled(config).loops, [TICK], self)
        self.last = self._mirror.records[TICK]

    def receive(self, timeout_s):
        """One datagram at a time, for the mirror."""
        datagram, self._waiting = self._waiting, None
        return datagram

    def until(self, happened):
        """Follow the ticks until something holds of the last one."""
        deadline, before = time.monotonic() + PATIENCE_S, self.last.index
        while time.monotonic() < deadline:
            self._waiting = self._listener.receive(PATIENCE_S)
            self._mirror.update()
            assert self.last.index >= before, "control began again"
            before = self.last.index
            if happened(self.last):
                return
        raise AssertionError(f"not within {PATIENCE_S:g} s; the last tick is {self.last.index}")

    def close(self):
        self._listener.close()


def children(parent):
    """Process ids by the name that follows `--process`."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            status, words = (process / "status").read_text(), (process / "cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
        if f"PPid:\t{parent}\n" in status and "--process" in words:
            found[words[words.index("--process") + 1]] = int(process.name)
    return found


def heard(session, sentence, seen):
    """Read what the session says until it says this."""
    for line in session.stderr:
        seen.append(line.strip())
        if line.strip() == f"ugv run: {sentence}":
            return
    raise AssertionError(f"not said: {sentence}; but {seen}")


@pytest.fixture
def session(tmp_path):
    """The session, what it said so far, and the ticks of its control."""
    with runtime_directory() as directory, ExitStack() as stack:
        config = load_configuration("uslgo1")
        hubs = [stack.enter_context(closing(UnixHub(directory / f"can{bus}"))) for bus in range(config.drives.buses)]
        changed = {
            "drives.interface": "ugv-unix",
            "drives.channels": json.dumps([str(hub.path) for hub in hubs]),
            "link.listen": json.dumps([f"tcp/127.0.0.1:{free_port()}"]),
        }
        command = [sys.executable, "-m", "runtime.cli.main", "run", "uslgo1"]
        command += ["--runtime-dir", str(directory), "--log-dir", str(tmp_path)]
        command += [part for key, value in changed.items() for part in ("--set", f"{key}={value}")]
        ticks = stack.enter_context(closing(Ticks(directory, load_configuration("uslgo1", changed))))
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT)
        try:
            yield process, ticks
        finally:
            process.terminate()
            process.wait(PATIENCE_S)
            process.stderr.close()


def schedules(process):
    """Policy and priority of each thread of a process."""
    threads = [int(task.name) for task in Path(f"/proc/{process}/task").iterdir()]
    return {thread: (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority) for thread in threads}


def times_woken(thread):
    """How often a thread has slept so far."""
    status = Path(f"/proc/{thread}/status").read_text()
    return int(status.split("\nvoluntary_ctxt_switches:")[1].split()[0])


def test_control_is_its_loops_that_run_first_where_they_may_and_a_main_thread_that_sleeps(session):
    process, ticks = session
    said = []
    heard(process, "the process control is ready", said)
    control, priorities = children(process.pid)["control"], [60, 80]
    ticks.until(lambda tick: tick.index > 0)
    woken, begun = times_woken(control), ticks.last.index
    ticks.until(lambda tick: tick.index > begun + TICKS_BESIDE)
    assert times_woken(control) == woken
    found = schedules(control)
    assert found.pop(control) == (os.SCHED_OTHER, 0)
    refused = {priority: try_priority(priority) for priority in priorities}
    assert sorted(found.values()) == sorted(
        (os.SCHED_OTHER, 0) if refused[priority] else (os.SCHED_FIFO, priority) for priority in priorities
    )
    for refusal in filter(None, refused.values()):
        assert f"ugv control: {refusal}" in said


def test_a_killed_recorder_comes_back_and_control_goes_on(session, tmp_path):
    process, ticks = session
    seen = []
    heard(process, "the process control is ready", seen)
    order = [f"ugv run: the process {name} is {how}" for name in ("recorder", "link") for how in ("started", "ready")]
    assert [line for line in seen if line in order] == order
    before = children(process.pid)
    assert set(before) == {"recorder", "link", "control"}
    ticks.until(lambda tick: tick.index > 0)
    killed_at = ticks.last.index

    os.kill(before["recorder"], signal.SIGKILL)
    heard(process, "the process recorder was killed by signal 9; it is to be started again in 0.2 s", seen)
    heard(process, "the process recorder is ready", seen)
    back_ns = time.monotonic_ns()
    ticks.until(lambda tick: tick.now_ns > back_ns + RECORDED_NS)
    after = children(process.pid)
    assert (after["control"], after["link"]) == (before["control"], before["link"])
    assert after["recorder"] != before["recorder"]

    process.terminate()
    said = [line.strip() for line in process.stderr]
    stopped = [line for line in said if "was told to stop" in line]
    assert [line.split()[4] for line in stopped] == ["control", "link", "recorder"]
    assert all(line.endswith("and ended with code 0") for line in stopped), said
    assert process.wait() == 0
    newest = max((path for path in tmp_path.iterdir() if path.is_dir()), key=lambda path: path.stat().st_mtime)
    recorded = Log(newest).read_signal(TICK).values["index"]
    assert recorded[0] > killed_at
    assert recorded[-1] >= ticks.last.index, "it was the last to stop"
