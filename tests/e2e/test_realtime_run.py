# SPDX-License-Identifier: Apache-2.0
"""`ugv sil --realtime` and `ugv run`: the processes of a robot against the wall clock, on whatever machine this is.

How often this machine stalls is not ours to say, so a run may end in a fault. What must hold is that the summary names
each fault and looks for its stall, that the log is whole and replays, and that nothing is left behind.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from runtime.configuration import dump
from runtime.executors.processes import Processes
from runtime.executors.runtime_directory import runtime_directory
from runtime.link.loop import STATUS
from runtime.link.topics import TAKEN
from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble
from sim_bridge.live_processes import wired
from sim_bridge.process import Task

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]
LOOPS = {"uslgo1": ("wbc", "mpc"), "4ws4wd": ("drive",)}


@pytest.fixture(scope="module", params=LOOPS)
def live(ugv, short_path, tmp_path_factory, request) -> subprocess.CompletedProcess[str]:
    """A short walk or drive in real time; `live.args[-1]` is its directory."""
    course = short_path if request.param == "uslgo1" else "straight-3"
    return ugv("sil", request.param, course, "--realtime", "--out", tmp_path_factory.mktemp("runs") / "live")


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
    explained = [fault for fault in summary["faults"] if fault["stall"] is not None]
    assert all(fault["stall"]["ms"] > fault["bound"]["ms"] for fault in explained)
    told = {key: summary[key] for key in ("faults", "pauses", "flaws", "fell", "fault", "lost_time_s")}
    assert summary["completed"] or summary["faults"] or summary["pauses"], f"what kept it from its goal is told: {told}"


def test_every_recorded_tick_replays_identically_if_none_is_missing(directory):
    log = Log(directory)
    result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    assert result.identical
    assert all(task.steps for task in result.tasks.values())
    assert result.gaps or result.stepped == result.recorded
    assert result.recorded == sum(log.counts()[f"/ugv/tick/{loop}"] for loop in LOOPS[log.robot])


def test_the_log_holds_what_every_process_did(directory):
    log = Log(directory)
    counts, rejected = log.counts(), log.read_signal(STATUS).values["rejected"][-1]
    for loop in (*LOOPS[log.robot], "link", "sim"):
        assert counts[f"/ugv/tick/{loop}"], loop
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


def test_the_one_command_that_runs_a_vehicle_drives_it_and_ends_in_order_when_told(tmp_path):
    """`ugv run` against the control unit at the far end of the bus; the simulator is another process."""
    ugv = [sys.executable, "-m", "runtime.cli.main"]
    with runtime_directory() as directory, wired("4ws4wd", {}, directory) as (config, _), Processes() as processes:
        file = directory / "config.toml"
        file.write_text(dump(config))
        far_end = processes.start("far end", [sys.executable, "-m", "sim_bridge.process"], piped=True)
        far_end.stdin.write(msgspec.json.encode(Task(str(file), "straight-3", 2, str(directory))) + b"\n")
        far_end.stdin.flush()
        assert "ready" in json.loads(far_end.stdout.readline())
        places = ["--config", file, "--runtime-dir", directory, "--log-dir", tmp_path]
        processes.start("ugv", [*map(str, [*ugv, "run", "4ws4wd", *places])])
        answers = map(json.loads, far_end.stdout)
        assert any("over" in answer for answer in answers)
        assert processes.stop("ugv", within_s=60.0) == 0
        processes.terminate("far end")
        outcome = next(answer["outcome"] for answer in answers if "outcome" in answer)
    assert outcome["completed"] or outcome["fault"]
    (bag,) = tmp_path.iterdir()
    log = Log(bag)
    assert not log.truncated
    assert log.counts()["/ugv/wheel_command_safe"]
    assert Replay(log, assemble(log.robot, log.config), log.robot).run().identical
