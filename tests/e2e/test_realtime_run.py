# SPDX-License-Identifier: Apache-2.0
"""`ugv sil --realtime`: the processes of a robot against the wall clock, on whatever machine this is.

How often this machine stalls is not ours to say, so a run may end in a fault. What must hold is that the summary names
each fault and looks for its stall, that the log is whole and replays, and that nothing is left behind.
"""

import json
import os
import subprocess
from pathlib import Path

import pytest

from runtime.link.loop import STATUS
from runtime.link.topics import TAKEN
from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]


@pytest.fixture(scope="module")
def live(ugv, short_path, tmp_path_factory) -> subprocess.CompletedProcess[str]:
    """A short walk in real time; `live.args[-1]` is its directory."""
    return ugv("sil", "uslgo1", short_path, "--realtime", "--out", tmp_path_factory.mktemp("runs") / "live")


@pytest.fixture(scope="module")
def directory(live) -> Path:
    assert live.returncode in (0, 1, 3), live.stderr
    return Path(live.args[-1])


def test_the_summary_says_how_it_went_and_looks_for_a_stall_before_each_fault(live, directory):
    summary = json.loads((directory / "summary.json").read_text())
    assert summary["realtime"]
    assert "Traceback" not in live.stderr
    assert {"recorder", "link", "sim", "control"} == set(summary["resources"])
    assert live.returncode != 0 or summary["completed"]
    assert bool(summary["fault"]) == (live.returncode == 3)
    stalls = [fault["stall"] for fault in summary["faults"] if fault["stall"] is not None]
    assert all(stall["ms"] >= 5.0 for stall in stalls)
    assert summary["completed"] or stalls, "only a machine that stalls keeps the robot from its goal"


def test_every_recorded_tick_replays_identically(directory):
    log = Log(directory)
    result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    assert result.identical
    assert all(task.steps for task in result.tasks.values())


def test_the_log_holds_what_every_process_did(directory):
    log = Log(directory)
    counts, rejected = log.counts(), log.read_signal(STATUS).values["rejected"][-1]
    for topic in ("/ugv/tick/wbc", "/ugv/tick/mpc", "/ugv/tick/link", "/ugv/tick/sim"):
        assert counts[topic], topic
    for topic, message in (("/ugv/imu", "/imu/data"), ("/ugv/localization", "/localization/pose")):
        assert counts[topic] or rejected[TAKEN.index(message)], f"{topic}: neither used nor counted as too old"
    summary = json.loads((directory / "summary.json").read_text())
    assert counts["/ugv/operator_event"] >= 3 or summary["fault"]


def test_nothing_is_left_behind(directory):
    assert sorted(file.name for file in directory.iterdir()) == [
        f"{directory.name}_0.mcap",
        "metadata.yaml",
        "report.html",
        "summary.json",
    ]
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        assert str(directory) not in command or int(process.name) == os.getpid()
