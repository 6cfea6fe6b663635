# SPDX-License-Identifier: Apache-2.0
"""`ugv sil` hands its arguments on, writes where it is told, and ends with the exit code that the outcome deserves."""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from runtime.cli import main as cli
from runtime.errors import ConfigError

SUMMARY = {
    "robot": "uslgo1",
    "completed": True,
    "fell": False,
    "fault": None,
    "lateral_error_m": {"mean": 0.0123456, "rms": 0.02},
    "realtime_factor": 2.5,
}


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """A simulator that only notes what it is asked, and answers with `SUMMARY` and what was asked of it."""
    made: list[dict[str, Any]] = []

    def run_scenario(robot: str, scenario: str, **options: Any) -> dict[str, Any]:
        made.append({"robot": robot, "scenario": scenario, **options})
        options["progress"](1.0, 2.0)
        (options["out"] / "summary.json").touch()
        return {**SUMMARY, **answer}

    answer: dict[str, Any] = {}
    run, report = ModuleType("sim_bridge.run"), ModuleType("runtime.recording.report")
    run.run_scenario = run_scenario  # type: ignore[attr-defined]
    report.write_report = lambda directory: directory / "report.html"  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "sim_bridge.run", run)
    monkeypatch.setitem(sys.modules, "runtime.recording.report", report)
    monkeypatch.setattr("sys.argv", ["ugv"])
    monkeypatch.chdir(tmp_path)
    run.answer = answer  # type: ignore[attr-defined]
    return made


def test_arguments_reach_the_simulator(calls: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]) -> None:
    arguments = "sil uslgo1 circle-6cm --seed 7 --estimator truth --controller pMW --set wbc.rate_hz=400 --out here"
    assert cli.main(arguments.split()) == 0
    (call,) = calls
    del call["progress"]
    assert call == {
        "robot": "uslgo1",
        "scenario": "circle-6cm",
        "seed": 7,
        "estimator": "truth",
        "controller": "pMW",
        "overrides": {"wbc.rate_hz": "400"},
        "out": Path("here"),
    }
    out = capsys.readouterr().out
    assert "mean 1.23, RMS 2.00 cm" in out
    assert "completed" in out
    assert "report: here/report.html" in out


def test_what_is_not_said_has_its_default(calls: list[dict[str, Any]]) -> None:
    assert cli.main(["sil", "uslgo1"]) == 0
    assert calls[0]["scenario"] == "flat"
    assert calls[0]["seed"] == 0
    assert calls[0]["out"] == Path("runs/uslgo1-flat-0")


@pytest.mark.parametrize(
    ("answer", "code"),
    [
        ({}, 0),
        ({"completed": False}, 1),
        ({"fell": True}, 1),
        ({"completed": False, "fault": "TILT"}, 3),
        ({"fault": ""}, 0),
        ({"flaws": ["control holds 21 open files, 20 before"]}, 1),
    ],
)
def test_the_outcome_is_the_exit_code(calls: list[dict[str, Any]], answer: dict[str, Any], code: int) -> None:
    sys.modules["sim_bridge.run"].answer.update(answer)
    assert cli.main(["sil", "uslgo1"]) == code


def test_a_run_on_a_path_of_ones_own_is_named_after_its_file(calls: list[dict[str, Any]]) -> None:
    assert cli.main(["sil", "uslgo1", "paths/yard.csv", "--seed", "2"]) == 0
    assert calls[0]["scenario"] == "paths/yard.csv"
    assert calls[0]["out"] == Path("runs/uslgo1-yard-2")


def test_a_refused_configuration_leaves_no_directory(
    calls: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(robot: str, scenario: str, **options: Any) -> None:
        raise ConfigError("--set: wbc.rate_hz = 5000 is above 1000")

    monkeypatch.setattr(sys.modules["sim_bridge.run"], "run_scenario", refuse)
    assert cli.main(["sil", "uslgo1", "--set", "wbc.rate_hz=5000"]) == 2
    assert "ugv: --set: wbc.rate_hz = 5000 is above 1000\n" in capsys.readouterr().err
    assert list(Path("runs").iterdir()) == []


def test_an_unfit_output_directory_is_refused_before_the_run(
    calls: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("file").touch()
    assert cli.main(["sil", "uslgo1", "--out", "file"]) == 2
    assert capsys.readouterr().err == "ugv: --out file: is not a directory\n"
    assert calls == []
