# SPDX-License-Identifier: Apache-2.0
"""A walk through the whole of it: run, summary, log, report, replay."""

import json
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from runtime.recording.compare import first_log_difference
from runtime.recording.log import Log, Message
from runtime.recording.recover import recover

pytestmark = pytest.mark.xdist_group("walk")

Ugv = Callable[..., subprocess.CompletedProcess[str]]
TASKS = ("decode", "authority", "estimator", "posture", "gait", "locomotion", "safety", "encode", "tracker", "mpc")
NO_MUJOCO = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("mujoco", "sim_bridge"):
            raise ImportError(name + " is not to be imported")
sys.meta_path.insert(0, Refuse())
"""


def test_it_walks_and_says_so(walk: subprocess.CompletedProcess[str], run_directory: Path) -> None:
    assert re.search(r"outcome +│ +completed ", walk.stdout)
    assert f"report: {run_directory / 'report.html'}" in walk.stdout
    assert (run_directory / "report.html").read_text().startswith("<!DOCTYPE html>")


def test_the_summary_has_its_keys(run_directory: Path) -> None:
    summary = json.loads((run_directory / "summary.json").read_text())
    assert summary["robot"] == "uslgo1"
    assert summary["seed"] == 3
    assert (summary["controller"], summary["estimator"]) == ("FpMW", "kalman")
    assert (summary["completed"], summary["fell"], summary["fault"]) == (True, False, "")
    keys = {
        "lateral_error_m": {"mean", "rms", "max", "std"},
        "heading_error_rad": {"rms", "max"},
        "tracking_error_m": {"mean", "std"},
        "speed_mps": {"mean", "commanded"},
        "mpc_ms": {"median", "p99", "max"},
        "wbc_ms": {"median", "p99", "max"},
        "missed_deadlines": {"mpc", "wbc"},
    }
    for key, parts in keys.items():
        assert parts <= summary[key].keys(), key
    for key in ("sim_time_s", "wall_time_s", "realtime_factor", "completion_time_s", "path_length_m"):
        assert summary[key] > 0.0, key
    assert (run_directory / summary["log"]).is_file()


def test_the_log_tells_what_is_in_it(ugv: Ugv, run_directory: Path) -> None:
    done = ugv("log", "info", run_directory)
    assert done.returncode == 0
    for topic in ("/imu/data", "/joint_states", "/odom", "/tf", "/path", "/cmd_vel", "/ugv/can_received"):
        assert topic in done.stdout


def identical_tasks(printed: str) -> set[str]:
    return {row.split("│")[1].strip() for row in printed.splitlines() if re.search(r"│ +identical │", row)}


def test_a_replay_without_the_simulator_is_identical(ugv: Ugv, run_directory: Path) -> None:
    done = ugv("replay", run_directory, code=NO_MUJOCO)
    assert done.returncode == 0, done.stderr
    assert identical_tasks(done.stdout) == set(TASKS)
    assert re.search(r"[1-9]\d* steps, [1-9]\d* signals compared: identical\n", done.stdout)


def test_a_replay_from_a_key_frame_is_identical(ugv: Ugv, run_directory: Path) -> None:
    done = ugv("replay", run_directory, "--from", 1.5, "--to", 2.5)
    assert done.returncode == 0, done.stderr
    assert identical_tasks(done.stdout) == set(TASKS)


def test_one_task_is_replayed_alone(ugv: Ugv, run_directory: Path) -> None:
    done = ugv("replay", run_directory, "--task", "tracker")
    assert done.returncode == 0, done.stderr
    assert identical_tasks(done.stdout) == {"tracker"}


def test_another_hash_seed_gives_the_same_log(ugv: Ugv, run_directory: Path, short_path: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    done = ugv("sil", "uslgo1", short_path, "--seed", 3, "--out", again, hash_seed="7")
    assert done.returncode == 0, done.stderr
    assert first_log_difference(Log(run_directory), Log(again)) is None


def test_a_change_reports_how_the_outputs_move(ugv: Ugv, run_directory: Path) -> None:
    done = ugv("replay", run_directory, "--set", "tracker.look_ahead.base_m=1.5", "--task", "tracker")
    assert done.returncode == 0, done.stderr
    assert re.search(r"/ugv/body_command +│ +look_ahead ", done.stdout)
    assert re.search(r"signals compared: \d+ fields move", done.stdout)


def test_a_flipped_bit_of_an_input_is_found_and_named(
    ugv: Ugv, run_directory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Log(run_directory)
    messages = log.messages

    def altered() -> Iterator[Message]:
        for message in messages():
            if message.topic == "/ugv/imu" and message.log_ns == 2_000_000_000:
                body = bytearray(message.body)
                body[40] ^= 1  # the last bit of angular_velocity[0], after two stamps and three accelerations
                message = message._replace(body=memoryview(body))
            yield message

    monkeypatch.setattr(log, "messages", altered)
    recover(log, tmp_path / "altered")
    done = ugv("replay", tmp_path / "altered")
    assert done.returncode == 1
    sentence = (
        r"tick 1000 of wbc \(2.000 s\): input /ugv/imu was altered .*; one flipped bit: angular_velocity\[0\] is "
    )
    assert re.search(sentence, done.stdout)
    assert re.search(r"first divergence: estimator, step 1000 \(2.000 s\): /ugv/body_state: ", done.stdout)


def test_a_scenario_that_fails_its_criteria_ends_with_one(ugv: Ugv, short_path: Path, tmp_path: Path) -> None:
    done = ugv("sil", "uslgo1", short_path, "--set", "tracker.speed.maximum_mps=0.05", "--out", tmp_path / "late")
    assert done.returncode == 1, done.stderr
    assert "NOT completed" in done.stdout


@pytest.mark.parametrize(
    ("key", "fault"), [("voltage_min_v=32", "VOLTAGE"), ("velocity_max_radps=3", "JOINT_VELOCITY")]
)
def test_a_robot_that_faults_ends_with_three(ugv: Ugv, short_path: Path, tmp_path: Path, key: str, fault: str) -> None:
    done = ugv("sil", "uslgo1", short_path, "--set", f"safety.{key}", "--out", tmp_path / "faulty")
    assert done.returncode == 3, done.stderr
    assert f"FAULT {fault}" in done.stdout
    assert json.loads((tmp_path / "faulty" / "summary.json").read_text())["fault"] == fault
    assert ugv("replay", tmp_path / "faulty").returncode == 0
