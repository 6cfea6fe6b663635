# SPDX-License-Identifier: Apache-2.0
"""`ugv experiment` and `ugv bench` print their figures beside what they are compared with."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.cli import main as cli
from runtime.cli.batch import Job
from runtime.cli.bench import dense_inference, percentiles
from runtime.cli.bench_tracker import controllers, step_times_ms
from runtime.cli.experiment import BASELINE, OURS, S_CURVE, average
from runtime.cli.experiment_faults import Outcome
from runtime.recording.settling import Settling
from runtime.tracking.fuzzy import infer
from sim_bridge.faults.live_campaign import Campaign
from sim_bridge.faults.live_judge import Verdict
from sim_bridge.paper_002 import trial as paper_002
from sim_bridge.paper_002.contenders import OURS as OURS_002
from sim_bridge.paper_002.contenders import PLAIN
from sim_bridge.paper_002.vehicle import Drive, settings_of
from sim_bridge.paper_002.vehicle_drive import Driven
from sim_bridge.paper_002.vehicle_drive import driven as driven_in_mujoco


def summary_of(job: Job, completed: bool = True) -> dict[str, Any]:
    """A run that reproduces the paper exactly."""
    controller = job.controller or OURS
    printed = S_CURVE[controller]
    return {
        "scenario": job.scenario,
        "controller": controller,
        "completed": completed,
        "fell": False,
        "completion_time_s": printed.time_s if completed else None,
        "tracking_error_m": {"mean": printed.mean_m, "std": printed.std_m},
        "lateral_error_m": {"rms": 0.01},
        "speed_mps": {"mean": 0.5},
    }


@pytest.mark.parametrize("completed", [True, False])
def test_paper_000_prints_measured_beside_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], completed: bool
) -> None:
    asked: list[Job] = []

    def run_jobs(jobs: Sequence[Job], progress: Any) -> list[dict[str, Any]]:
        asked.extend(jobs)
        return [summary_of(job, completed) for job in jobs]

    monkeypatch.setattr("runtime.cli.batch.run_jobs", run_jobs)
    assert cli.main(["experiment", "paper-000", "--seeds", "2"]) == (0 if completed else 1)
    assert len(asked) == 3 + 2 * len(S_CURVE)
    out = capsys.readouterr().out
    assert out.count("0.5457") == (2 if completed else 1)
    assert out.count("0.8533") == (2 if completed else 1)


def test_runs_that_were_not_completed_do_not_count() -> None:
    runs = [summary_of(Job("s-curve", controller=BASELINE)), summary_of(Job("s-curve"), completed=False)]
    assert average(runs) == S_CURVE[BASELINE]
    assert average(runs[1:]) is None


@given(st.floats(-4, 4), st.floats(-4, 4))
def test_the_fuzzy_yardstick_agrees(e: float, ec: float) -> None:
    assert dense_inference(e, ec) == pytest.approx(infer(e, ec), abs=1e-12)


def test_percentiles_are_median_high_and_largest() -> None:
    assert percentiles(range(101)) == (50.0, 99.0, 100.0)


@pytest.mark.parametrize(
    ("chosen", "robots"), [((), {"uslgo1", "4ws4wd"}), (("--robot", "4ws4wd"), {"4ws4wd"})], ids=["both", "one"]
)
@pytest.mark.parametrize("flaws", [(), ("seed 1: answer is drive on",)])
def test_faults_are_printed_beside_their_answers_and_a_difference_fails(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    flaws: tuple[str, ...],
    chosen: tuple[str, ...],
    robots: set[str],
) -> None:
    def tried(place: tuple[str, int], seeds: Sequence[int]) -> Outcome:
        assert list(seeds) == [0, 1]
        robot, number = place
        tried_of.add(robot)
        return Outcome(f"fault {number}", "damp", "damp", 12.0, 8.0, True, flaws if place == ("4ws4wd", 3) else ())

    def in_this_process(run: Any, items: Sequence[tuple[str, int]], progress: Any) -> list[Outcome]:
        return [run(item) for item in items]

    tried_of: set[str] = set()
    monkeypatch.setattr("runtime.cli.experiment_faults.try_fault", tried)
    monkeypatch.setattr("runtime.cli.batch.in_processes", in_this_process)
    assert cli.main(["experiment", "faults", "--seeds", "2", *chosen]) == (1 if flaws else 0)
    assert tried_of == robots
    out = capsys.readouterr().out
    assert "fault 3" in out
    assert ("4ws4wd: fault 3, seed 1: answer is drive on" in out) == bool(flaws)
    assert out.count("DIFFERS") == len(flaws)


def verdict_of(name: str, flaws: tuple[str, ...] = (), stall_ms: float = 0.0) -> Verdict:
    """A trial in real time, whose flaws any stall excuses."""
    return Verdict(name, ("damp",), ("damp",), 30.0, 12.0, True, flaws, stall_ms, bool(flaws and stall_ms))


@pytest.mark.parametrize(
    ("trials", "judgement", "code"),
    [
        ([verdict_of("link killed")], "as expected", 0),
        ([verdict_of("link killed", ("it fell",), 40.0), verdict_of("link killed")], "as expected", 0),
        ([verdict_of("link killed", ("it fell",))], "DIFFERS", 1),
        ([verdict_of("link killed", ("it fell",), 40.0)], "NOT SHOWN", 1),
    ],
)
def test_faults_in_real_time_that_only_a_stall_explains_show_nothing(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    trials: list[Verdict],
    judgement: str,
    code: int,
) -> None:
    asked: list[Any] = []

    def campaign(rows: Sequence[Any], phases: int, seed: int, out: Any, told: Any) -> Campaign:
        asked.extend(row.name for row in rows)
        return Campaign({row.name: trials for row in rows}, {}, [])

    monkeypatch.setattr("sim_bridge.faults.live_campaign.campaign", campaign)
    assert cli.main(["experiment", "faults", "--realtime", "--only", "link killed"]) == code
    assert asked == ["link killed"]
    out = capsys.readouterr().out
    assert judgement in out
    assert ("a stall of 40 ms" in out) == any(trial.stall_ms for trial in trials)


def test_a_fault_that_there_is_none_of_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["experiment", "faults", "--realtime", "--only", "flood of tears"]) == 2
    assert "flood of tears" in capsys.readouterr().err


@pytest.mark.parametrize("options", [("--robot", "4ws5wd"), ("--robot", "4ws4wd", "--realtime")])
def test_faults_of_a_robot_that_has_no_table_of_them_are_refused(
    capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    assert cli.main(["experiment", "faults", *options]) == 2
    assert options[1] in capsys.readouterr().err


def driven(trial: paper_002.Trial, error_m: float = 0.02) -> paper_002.Outcome:
    """An outcome in which pure pursuit does badly and all others alike."""
    error_m = 0.3 if trial.contender.controller == "pure-pursuit" else error_m
    t = np.arange(3.0)
    settling = Settling(7.0, 0.01, error_m, error_m, error_m)
    angle = error_m if trial.contender.controller != "pure-pursuit" else 1.0
    return paper_002.Outcome(trial, True, error_m, settling, angle, 0.0, t, np.column_stack((t, t)), t)


@pytest.mark.parametrize(("error_m", "code"), [(0.02, 0), (0.29, 1)])
def test_paper_002_prints_claims_and_findings_and_writes_its_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, error_m: float, code: int
) -> None:
    def in_processes(run: Any, trials: Sequence[paper_002.Trial], progress: Any) -> list[paper_002.Outcome]:
        assert run is paper_002.drive
        return [driven(trial, error_m) for trial in trials]

    monkeypatch.setattr("runtime.cli.batch.in_processes", in_processes)
    monkeypatch.setattr("sim_bridge.paper_002.pictures.pictures", lambda results: [])
    out = tmp_path / "report"
    assert cli.main(["experiment", "paper-002", "--plant", "kinematic", "--out", str(out)]) == code
    printed = capsys.readouterr().out
    for title in ("Table II", "Claims", "Curves after the first 12 s: ratio"):
        assert title in printed
    assert "MuJoCo" not in printed
    assert ("MISSED" in printed) == bool(code)
    assert "- Straight: in the paper K_r 0.9 lowers the mean error from 0.234 to 0.209 m" in printed
    assert f"report: {out / 'report.html'}" in printed.replace("\n", "")
    assert "Table II" in (out / "report.html").read_text()


FIGURES = {"mean_25_s_m": 0.2, "time_s": 7.0, "overshoot_m": 0.0, "mean_after_m": 0.01}


@pytest.fixture
def asked_drives(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[Drive]]:
    """Has drives done without MuJoCo, those of one contender unfinished; gives those that are asked for."""

    def start(unfinished: str) -> list[Drive]:
        asked: list[Drive] = []

        def in_processes(run: Any, drives: Sequence[Drive], progress: Any) -> list[Driven]:
            assert run is driven_in_mujoco
            asked.extend(drives)
            summaries = [{"completed": drive.contender.name != unfinished, "settling": FIGURES} for drive in drives]
            return [Driven(drive, summary) for drive, summary in zip(drives, summaries, strict=True)]

        monkeypatch.setattr("runtime.cli.batch.in_processes", in_processes)
        return asked

    return start


def test_paper_002_drives_the_simulated_vehicle_with_every_controller(
    asked_drives: Callable[[str], list[Drive]], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = asked_drives("")
    arguments = ["experiment", "paper-002", "--plant", "mujoco", "--seeds", "2", "--out", str(tmp_path / "report")]
    assert cli.main(arguments) == 0
    assert {drive.contender.controller for drive in asked} == set(controllers())
    assert {drive.seed for drive in asked} == {0, 1}
    delays = {settings_of(drive)["simulation.command_delay_ns"] for drive in asked}
    assert delays == {"0", "300000000", "600000000"}
    printed = capsys.readouterr().out
    assert "Table II" not in printed
    assert "10 of 10" in printed


@pytest.mark.parametrize(("unfinished", "code"), [("", 0), (PLAIN.name, 0), (OURS_002.name, 1)])
def test_paper_002_fails_when_ours_does_not_complete_a_drive_of_the_few_that_tell_most(
    asked_drives: Callable[[str], list[Drive]],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    unfinished: str,
    code: int,
) -> None:
    asked = asked_drives(unfinished)
    arguments = ["experiment", "paper-002", "--plant", "mujoco", "--quick", "--out", str(tmp_path / "report")]
    assert cli.main(arguments) == code
    assert len(asked) == 16
    assert ("MISSED" in capsys.readouterr().out) == bool(code)


def test_paper_002_writes_over_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "kept").write_text("kept")
    monkeypatch.setattr("runtime.cli.batch.in_processes", lambda *_: pytest.fail("drove before it looked"))
    assert cli.main(["experiment", "paper-002", "--out", str(tmp_path)]) == 2
    assert "already holds files" in capsys.readouterr().err


def test_the_tracker_is_timed_on_its_way() -> None:
    times = step_times_ms("steered-return", 0.5)
    assert len(times) == 25
    assert min(times) > 0.0
