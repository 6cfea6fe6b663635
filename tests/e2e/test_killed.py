# SPDX-License-Identifier: Apache-2.0
"""Whenever `ugv sil --realtime` or `ugv run` is killed, no process of theirs lives on and no file is left behind."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

from drivers.unix_hub import UnixHub
from runtime.cli.run import PROCESSES
from runtime.executors.runtime_directory import runtime_directory
from runtime.executors.tick_stream import LINK_SOCKET, OBSERVER_SOCKET, RECORDER_SOCKET
from runtime.robots import load_configuration

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]

ROOT = Path(__file__).parents[2]
UGV = [sys.executable, "-m", "runtime.cli.main"]
PATIENCE_S = 60.0


def children(parent):
    """Command lines by process id."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if f"\nPPid:\t{parent}\n" in (process / "status").read_text():
                found[int(process.name)] = (process / "cmdline").read_bytes().decode().split("\0")
    return found


def awaited(happened):
    """What comes of a question that is asked until it has an answer."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        answer = happened()
        if answer:
            return answer
        os.sched_yield()
    raise AssertionError(f"not within {PATIENCE_S:g} s")


def directory_of(parent):
    """The runtime directory of a run, which the command lines of its processes name."""
    words = (word for command in children(parent).values() for word in command if "/ugv-run-" in word)
    return next((Path(word) for word in words if Path(word).is_dir()), None)


def kill(process):
    """Kill a process and see that all that it had started end."""
    with ExitStack() as stack:
        handles = []
        for pid in children(process.pid):
            with suppress(ProcessLookupError):
                handles.append(os.pidfd_open(pid))
                stack.callback(os.close, handles[-1])
        process.send_signal(signal.SIGKILL)
        process.wait()
        for handle in handles:
            assert select.select([handle], [], [], PATIENCE_S)[0], "a process lives on"
        return len(handles)


def log_of_a_walk(out):
    """Whether control's ticks are in the log: those of the link alone do not make so much of it."""
    return any(log.stat().st_size > 1_000_000 for log in out.rglob("*.mcap"))


@pytest.mark.parametrize("moment", [".", RECORDER_SOCKET, LINK_SOCKET, OBSERVER_SOCKET, "walk"])
def test_a_run_in_real_time_that_is_killed_leaves_nothing(tmp_path, moment):
    """Killed when a file is in its runtime directory, or when the robot is about."""
    command = [*UGV, "sil", "uslgo1", "straight-3", "--realtime", "--out", str(tmp_path / "run")]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        directory = awaited(lambda: directory_of(process.pid))
        awaited((lambda: log_of_a_walk(tmp_path)) if moment == "walk" else (directory / moment).exists)
        assert kill(process)
        said = process.stderr.read().decode()
    assert not directory.exists()
    assert not directory.with_name(directory.name.replace("-run-", "-gone-")).exists()
    assert "Traceback" not in said


def test_a_session_that_is_killed_leaves_no_process_and_no_socket(tmp_path):
    with runtime_directory() as directory, ExitStack() as stack:
        config = load_configuration("uslgo1")
        hubs = [stack.enter_context(closing(UnixHub(directory / f"can{bus}"))) for bus in range(config.drives.buses)]
        channels = json.dumps([str(hub.path) for hub in hubs])
        command = [*UGV, "run", "uslgo1", "--runtime-dir", str(directory), "--log-dir", str(tmp_path)]
        command += ["--set", "drives.interface=ugv-unix", "--set", f"drives.channels={channels}"]
        command += ["--set", 'link.listen=["tcp/127.0.0.1:0"]']
        with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE) as process:
            awaited(lambda: log_of_a_walk(tmp_path))
            assert kill(process) >= len(PROCESSES)
            said = process.stderr.read().decode()
        assert not list(directory.glob("*.sock"))
    assert "Traceback" not in said
