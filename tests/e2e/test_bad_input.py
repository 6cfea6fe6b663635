# SPDX-License-Identifier: Apache-2.0
"""Bad input through `ugv`: one clear sentence that names what and where, exit code 2, and nothing recorded is lost."""

import resource
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.cli.main import main
from runtime.recording.bag import BagSink
from runtime.recording.log import Log
from runtime.recording.setup import recording_setup
from runtime.robots import ROBOTS, load_configuration
from runtime.robots.uslgo1.assembly import assemble

pytestmark = pytest.mark.xdist_group("walk")

Ugv = Callable[..., subprocess.CompletedProcess[str]]
Refusal = Callable[..., str]
LOG_LIMIT_BYTES = 1_500_000


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Refusal:
    """Runs a command that is to be refused, and gives the sentence."""

    def run(*arguments: object) -> str:
        monkeypatch.chdir(tmp_path)
        assert main([str(argument) for argument in arguments]) == 2
        sentence = capsys.readouterr().err.strip()
        assert sentence.startswith("ugv")
        assert len(sentence.splitlines()) == 1, sentence
        assert not list(tmp_path.glob("runs/*")), "a refused run leaves nothing behind"
        return sentence

    return run


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("sil uslgo2", "robot 'uslgo2' is unknown; did you mean uslgo1?"),
        (
            "sil uslgo1 stand --realtime --duration 60",
            "is for scenarios with a path to follow, and stand has",
        ),
        ("sil uslgo1 flat --realtime --duration 60", "that leads back to its start, and that of flat does not"),
        ("sil 4ws4wd crab --realtime --duration 60", "is for scenarios with a path to follow, and crab has"),
        ("sil uslgo1 circle-7cm", "scenario 'circle-7cm' is unknown; did you mean circle-6cm?"),
        ("sil uslgo1 slope-up-50", "scenario 'slope-up-50': 50 degrees is not above 0 and at most 35"),
        ("sil uslgo1 --controller MPC", 'variant.controller = "MPC" is not one of FpM, FpMW, pMW'),
        ("sil uslgo1 --set gait.pace=1", "--set: gait.pace is unknown; known there: period_ns, stance_fraction"),
        (
            "sil uslgo1 --set gait.period_s=1",
            "gait.period_s is unknown; did you mean gait.period_ns? It wants ns, not s",
        ),
        ("sil uslgo1 --set posture.height_m=29cm", 'posture.height_m = "29cm" is text with a unit; write the number'),
        ("sil uslgo1 --set posture.height_m=0.6", "posture.height_m = 0.6 is above 0.42"),
        ("sil uslgo1 --set safety.tilt_max_rad=nan", "safety.tilt_max_rad = nan is not finite"),
        ("sil uslgo1 --set scenario.speed_mps=3", "scenario.speed_mps = 3 is above 2"),
        ("sil uslgo1 --seed -1", "argument --seed: -1 is not from 0 to 4294967295"),
        (
            "config check uslgo1 --set drives.bit_rate_hz=125000",
            "bus 0: 500 Hz with 3 classic-8 drives loads 0.125 Mbit/s",
        ),
        ("config check uslgo1 --set drives.can_id.1=1", "joints left_front_abad and left_front_hip share id"),
        ("config check uslgo1 --set loops.mpc_hz=60", "loops.mpc_hz = 60 does not divide 500"),
        ("config check uslgo1 --set loops.mpc_budget_ns=30000000", "is above the loop's period of 20000000"),
        (
            "config check uslgo1 --set safety.voltage_min_v=40",
            "safety.voltage_min_v = 40.0 is not below voltage_max_v = 34.0",
        ),
        ("config check uslgo1 --set safety.effort_max_nm=100", "needs 100 N.m at the drive, whose range is -40 to 40"),
        (
            "config check uslgo1 --set mpc.force_min_n=100 --set mpc.force_max_n=50",
            "mpc.force_min_n = 100 is above mpc.force_max_n = 50",
        ),
        ("config check uslgo1 --set tracker.look_ahead.maximum_m=0.5", "tracker.look_ahead.minimum_m = 0.6 is above"),
        (
            "config check uslgo1 --set simulation.time_step_ns=3000000",
            "does not divide the fast loop's period of 2000000",
        ),
        ("config check uslgo1 --set simulation.imu_rate_hz=333", "gives a period that is no multiple of time_step_ns"),
        ("config check no.toml", "no.toml: cannot be read: No such file or directory"),
        ("bench all", "argument part: invalid choice: 'all'"),
        ("experiment paper-003", "experiment 'paper-003' is unknown; did you mean paper-002?"),
        ("replay nothing", "nothing: there is no such run"),
        ("march", "command 'march' is unknown"),
    ],
)
def test_what_is_unknown_or_impossible_is_named(refusal: Refusal, arguments: str, sentence: str) -> None:
    assert sentence in refusal(*arguments.split())


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("x,y\n0,0\n", "the path has 1 point, at least 2 are needed"),
        ("", "the path has no points, at least 2 are needed"),
        ("0,0\n1,nan\n2,0\n", "row 2: y is nan, which is not a finite number"),
        ("0,0\n1,0\n\n1,0\n", "row 4: (1, 0) repeats the point before"),
        ("0,0\n1,0\n0,0.01\n", "row 2: the path turns back by 179 degrees, at most 150 can be followed"),
        ("0,0\n1;0\n", "row 2: has 1 column, x,y are needed"),
        ("0,0\n1,zero\n", "row 2: y is 'zero', which is not a number"),
        ("\n".join(f"{i / 100},0" for i in range(1025)), "the path has 1025 points, at most 1024 fit"),
    ],
)
def test_a_path_that_cannot_be_followed_is_named_with_its_row(
    refusal: Refusal, tmp_path: Path, content: str, sentence: str
) -> None:
    file = tmp_path / "path.csv"
    file.write_text(content)
    assert refusal("sil", "uslgo1", file) == f"ugv: {file}: {sentence}"


def test_a_path_file_that_is_missing_or_binary_is_named(refusal: Refusal, tmp_path: Path) -> None:
    assert refusal("sil", "uslgo1", "none.csv") == "ugv: none.csv: cannot be read (No such file or directory)"
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe0")
    assert refusal("sil", "uslgo1", "binary.csv") == "ugv: binary.csv: is not UTF-8 text (byte 0)"


def test_an_output_that_cannot_be_written_is_refused_before_the_run(refusal: Refusal, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    assert refusal("sil", "uslgo1", "--out", "file") == "ugv: --out file: is not a directory"
    assert "--out file/below: cannot be written to: Not a directory" in refusal("sil", "uslgo1", "--out", "file/below")
    assert "/proc/ugv: cannot be written to" in refusal("sil", "uslgo1", "--out", "/proc/ugv")
    assert (tmp_path / "file").read_text() == "kept"


def test_a_run_is_never_written_over_another(refusal: Refusal, run_directory: Path) -> None:
    before = {file: file.stat().st_mtime_ns for file in run_directory.iterdir()}
    assert "already holds files" in refusal("sil", "uslgo1", "--out", run_directory)
    assert {file: file.stat().st_mtime_ns for file in run_directory.iterdir()} == before


def test_a_disk_that_fills_up_ends_the_run_and_keeps_the_log(ugv: Ugv, short_path: Path, tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (LOG_LIMIT_BYTES, LOG_LIMIT_BYTES))

    out = tmp_path / "full"
    done = ugv("sil", "uslgo1", short_path, "--out", out, limit=limit)
    assert done.returncode == 2
    (sentence,) = (line for line in done.stderr.splitlines() if line.startswith("ugv: "))
    assert f"cannot record any more in {out / 'full_0.mcap'}: file too large; the log is whole up to" in sentence
    assert Log(out).end_ns > 500_000_000
    replayed = ugv("replay", out)
    assert replayed.returncode == 0, replayed.stderr
    assert "signals compared: identical" in replayed.stdout


@pytest.fixture
def cut_off(run_directory: Path, tmp_path: Path) -> Path:
    """The walk's log without its last third."""
    run = tmp_path / "cut"
    shutil.copytree(run_directory, run)
    (file,) = run.glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[: 2 * len(content) // 3])
    return run


def test_a_log_that_was_cut_off_is_read_as_far_as_it_is_whole(ugv: Ugv, cut_off: Path) -> None:
    for verb in (("log", "info"), ("report",)):
        assert ugv(*verb, cut_off).returncode == 0
    assert "The log was cut off; it is whole up to" in (cut_off / "report.html").read_text()
    replayed = ugv("replay", cut_off)
    assert replayed.returncode == 0, replayed.stderr
    assert "was cut off; it was replayed up to" in replayed.stdout
    assert "signals compared: identical" in replayed.stdout


def test_what_is_whole_of_a_cut_off_log_is_saved(ugv: Ugv, cut_off: Path) -> None:
    done = ugv("log", "recover", cut_off)
    assert done.returncode == 0, done.stderr
    saved = Log(cut_off.with_name("cut-recovered"))
    assert not saved.truncated
    assert saved.counts() == Log(cut_off).counts()


@pytest.mark.parametrize("verb", ["replay", "report", "log info"])
def test_what_is_no_log_is_named(refusal: Refusal, tmp_path: Path, verb: str) -> None:
    run = tmp_path / "run"
    run.mkdir()
    assert refusal(*verb.split(), run) == f"ugv: {run} holds no .mcap file"
    file = run / "run_0.mcap"
    file.touch()
    assert refusal(*verb.split(), run) == f"ugv: {file} is empty"
    file.write_text("a diary")
    assert refusal(*verb.split(), run) == f"ugv: {file} is not an MCAP file"


def test_a_log_of_another_robot_is_named(refusal: Refusal, tmp_path: Path) -> None:
    robot = assemble(load_configuration("uslgo1"))
    sink = BagSink(tmp_path / "other", recording_setup(robot.loops, "titan8", "", 0, robot.joint_names))
    sink.close()
    file = tmp_path / "other" / "other_0.mcap"
    assert refusal("replay", file) == f"ugv: {file} is a log of titan8; the robots here are {', '.join(ROBOTS)}"


def test_a_task_that_the_log_does_not_have_is_named(refusal: Refusal, run_directory: Path) -> None:
    refused = refusal("replay", run_directory, "--task", "dance")
    assert "has no task dance; its tasks are decode, authority, estimator" in refused
    assert "--to 1 is not after --from 2" in refusal("replay", run_directory, "--from", 2, "--to", 1)
