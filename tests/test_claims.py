# SPDX-License-Identifier: Apache-2.0
"""The table of claims fails when a bound is missed, and never because of a time."""

import importlib.util
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

Run = Callable[..., int]

GOOD = {
    "completed": True,
    "fell": False,
    "lateral_error_m": {"rms": 0.005, "max": 0.01},
    "tracking_error_m": {"mean": 0.02},
    "speed_mps": {"mean": 0.6, "commanded": 0.6},
    "mpc_ms": {"p99": 1.0},
    "wbc_ms": {"median": 0.3, "p99": 0.5},
    "drive_ms": {"p99": 1.0},
    "realtime_factor": 3.0,
    "push": {"passed": True, "back_at_speed": True},
    "heading_error_rad": {"max": 0.1},
    "patch": {"speed_entry_mps": 3.0, "speed_least_mps": 1.8},
}


@pytest.fixture
def claims() -> ModuleType:
    """The script, loaded from beside this file."""
    specification = importlib.util.spec_from_file_location("claims_script", Path(__file__).with_name("claims.py"))
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules["claims_script"] = module
    specification.loader.exec_module(module)
    return module


@pytest.fixture
def run(claims: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the table on runs that are all good but for what is given."""

    def start(*arguments: str, differing: bool = False, missed: int = 0, step_ms: float = 0.1, **changes: Any) -> int:
        def run_jobs(jobs: Sequence[Any], progress: Any) -> list[dict[str, Any]]:
            return [{**GOOD, **changes} for _ in jobs]

        monkeypatch.setattr(claims, "run_jobs", run_jobs)
        monkeypatch.setattr(claims, "run_of_hash_seed", lambda hash_seed, directory: None)
        monkeypatch.setattr(claims, "recorded_difference", lambda summaries: float(differing))
        monkeypatch.setattr(claims, "replayed_difference", lambda summaries: float(differing))
        monkeypatch.setattr(claims, "paper_002_missed", lambda summaries: float(missed))
        monkeypatch.setattr(claims, "tracker_step_p99_ms", lambda summaries: step_ms)
        return int(claims.main(arguments))

    return start


@pytest.mark.parametrize("arguments", [(), ("--full",)])
def test_good_runs_keep_every_claim(run: Run, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> None:
    assert run(*arguments) == 0
    out = capsys.readouterr().out
    assert "lines: completed" in out
    assert "MISSED" not in out


@pytest.mark.parametrize(
    "change",
    [
        {"completed": False},
        {"fell": True},
        {"lateral_error_m": {"rms": 0.2, "max": 0.01}},
        {"lateral_error_m": {"rms": 0.005, "max": 0.4}},
        {"lateral_error_m": {"rms": math.nan, "max": 0.01}},
        {"tracking_error_m": {"mean": 0.2}},
        {"speed_mps": {"mean": 0.5, "commanded": 0.6}},
        {"push": {"passed": True, "back_at_speed": False}},
        {"push": {"passed": False, "back_at_speed": True}},
        {"patch": {"speed_entry_mps": 3.0, "speed_least_mps": 2.7}},
        {"heading_error_rad": {"max": 2.0}},
        {"differing": True},
        {"missed": 1},
    ],
)
def test_a_missed_bound_fails(run: Run, capsys: pytest.CaptureFixture[str], change: dict[str, Any]) -> None:
    assert run(**change) == 1
    assert "MISSED" in capsys.readouterr().out


def test_slow_machines_do_not_fail(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(mpc_ms={"p99": 50.0}, realtime_factor=0.1, step_ms=9.0) == 0
    assert "not on this machine" in capsys.readouterr().out


def test_claims_of_paper_002_that_are_missed_are_counted_and_named(
    claims: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sim_bridge.paper_002.claims import Claim

    made = [Claim("near", 0.1, 0.2, 0.1), Claim("far", 0.3, 0.2, 0.1), Claim("beside", 0.3, 0.2, 0.1, decides=False)]
    monkeypatch.setattr("runtime.cli.experiment_paper_002.drive_kinematic", lambda: None)
    monkeypatch.setattr("sim_bridge.paper_002.claims.claims", lambda results: made)
    assert claims.paper_002_missed([]) == 1.0
    assert capsys.readouterr().err == "claims: far: 0.3 is above 0.2\n"


def test_the_full_table_has_the_seeds_that_are_claimed(claims: ModuleType) -> None:
    runs = {claim.name: len(claim.jobs) for claim in claims.claims(full=True)}
    assert runs["lines: completed"] == 40
    assert runs["s-curve: completed"] == 10
    assert runs["push of 10 N.s: withstood"] == 8 * 4 * 5
    assert runs["trot at 1.2 m/s: deviation"] == 5
    (drives,) = (claim for claim in claims.vehicle_claims(full=True) if claim.name == "4ws4wd: completed")
    assert {(job.scenario, job.seed) for job in drives.jobs} == {(s, n) for s in claims.DRIVES for n in range(20)}


def test_a_few_pushes_come_from_every_side_and_at_every_gait_phase(claims: ModuleType) -> None:
    (push,) = (claim for claim in claims.claims(full=False) if claim.name == "push of 10 N.s: withstood")
    assert {job.seed % 8 for job in push.jobs} == set(range(8))
    assert {job.seed // 8 % 4 for job in push.jobs} == set(range(4))


def test_a_fast_trot_is_steady_for_ten_seconds(claims: ModuleType) -> None:
    from sim_bridge.courses import scenario

    for speed in claims.FASTEST_TROTS_MPS:
        course = scenario(claims.straight(speed)).with_speed(speed)
        assert course.nominal_time_s - 2.0 / speed >= 10.0


def test_a_claim_that_nothing_matches_is_named(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--only", "flying") == 2
    assert capsys.readouterr().err == "claims: none contains 'flying'\n"
