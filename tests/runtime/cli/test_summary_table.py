# SPDX-License-Identifier: Apache-2.0
"""The table of a run says in words and units what `summary.json` says in keys."""

from typing import Any

import pytest

from runtime.cli.summary_table import outcome, print_summary, summary_rows

WALK: dict[str, Any] = {
    "robot": "uslgo1",
    "scenario": "push",
    "seed": 3,
    "controller": "FpMW",
    "estimator": "kalman",
    "completed": True,
    "completion_time_s": 18.127,
    "path_length_m": 10.0,
    "lateral_error_m": {"mean": 0.0073, "rms": 0.0096, "max": 0.0308, "std": None},
    "heading_error_rad": {"rms": 0.01246, "max": 0.04048},
    "tracking_error_m": {"mean": 0.0073, "std": 0.0063},
    "speed_mps": {"mean": 0.5995, "commanded": 0.6},
    "push": {
        "passed": True,
        "back_at_speed": False,
        "displacement_m": 0.125,
        "distance_later_m": 0.02,
        "speed_later_mps": 0.4,
    },
    "fell": False,
    "fault": "",
    "sim_time_s": 20.56,
    "wall_time_s": 10.28,
    "realtime_factor": 2.0,
    "wbc_ms": {"median": 0.4, "p99": 0.8, "max": 123.4},
    "mpc_ms": {"median": 1.0, "p99": 1.5, "max": 2.0},
    "missed_deadlines": {"wbc": 2, "mpc": 0},
    "log": "run_0.mcap",
}


def test_every_figure_is_said_with_its_unit() -> None:
    assert dict(summary_rows(WALK)) == {
        "outcome": "completed",
        "time to the goal": "18.13 s",
        "path length": "10.00 m",
        "mean speed": "0.600 m/s, commanded 0.600 m/s",
        "lateral error": "mean 0.73, RMS 0.96, max 3.08 cm",
        "heading error": "RMS 0.71, max 2.32 degrees",
        "tracking error (eq 46, 47)": "mean 0.73, std 0.63 cm",
        "push": "withstood, NOT back at speed in 3 s, displaced by up to 12.5 cm, 2.0 cm off 5 s later",
        "WBC tick": "median 0.40, p99 0.80, max 123 ms",
        "MPC step": "median 1.00, p99 1.50, max 2.00 ms",
        "longer than their period": "2 of wbc, 0 of mpc",
        "simulated": "20.56 s in 10.28 s: 2.00 times real time",
    }


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ((3.0, 1.894, 2.42), ", entered at 3.00 m/s, slowest 1.89 m/s, mean 2.42 m/s"),
        ((None, None, None), ""),
    ],
)
def test_a_slippery_patch_is_told_of(speeds: tuple[float | None, ...], said: str) -> None:
    entry, least, mean = speeds
    patch = {"side_slip_max_rad": 0.1, "speed_entry_mps": entry, "speed_least_mps": least, "speed_mean_mps": mean}
    rows = dict(summary_rows({"completed": True, "patch": patch}))
    assert rows["slippery patch"] == f"side slip up to 5.7 degrees{said}"


SIM_STALL, WBC_STALL = {"loop": "sim", "ms": 34.2}, {"loop": "wbc", "ms": 5.0}
SLOW = {"ticks": 3, "took_ms": 6.08, "need_ms": 1.08}


def test_a_walk_against_the_clock_tells_of_laps_losses_and_what_is_held() -> None:
    early = {"resident_bytes": 120_000_000, "open_files": 20, "mapped_files": 300}
    summary = {
        "completed": True,
        "laps": 8,
        "flaws": ["control holds 23 open files, 20 before"],
        "faults": [
            {"fault": "STALE_IMU", "bound": {"loops": ["sim"], "ms": 16.0}, "stall": SIM_STALL, "slow": None},
            {"fault": "STALE_IMU", "bound": {"loops": ["sim"], "ms": 16.0}, "stall": None, "slow": None},
            {"fault": "TILT", "bound": None, "stall": None, "slow": None},
        ],
        "pauses": [
            {"fault": "LATE_LOOP", "bound": {"loops": ["wbc"], "ms": 3.6}, "stall": WBC_STALL, "slow": None},
            {"fault": "LATE_LOOP", "bound": {"loops": ["wbc"], "ms": 3.6}, "stall": WBC_STALL, "slow": SLOW},
        ],
        "imu_age_ms": {"median": 0.64, "p99": 2.7, "max": 12.0},
        "resources": {
            "control": {"early": early, "late": early | {"open_files": 23}},
            "link": {"early": None, "late": early},
        },
    }
    assert list(summary_rows(summary)) == [
        ("outcome", "completed"),
        ("flaw", "control holds 23 open files, 20 before"),
        ("laps", "8"),
        ("power lost", "STALE_IMU, after a stall of sim of 34.2 ms beyond 16 ms"),
        ("power lost", "STALE_IMU, no stall beyond 16 ms"),
        ("power lost", "TILT, which no stall makes"),
        ("paused", "LATE_LOOP, after a stall of wbc of 5 ms beyond 3.6 ms"),
        (
            "paused",
            "LATE_LOOP, after a stall of wbc of 5 ms beyond 3.6 ms"
            " (3 ticks computed for 6.08 ms; stepped again, for 1.08 ms)",
        ),
        ("age of inertial samples", "median 0.64, p99 2.70, max 12.00 ms"),
        ("held by control", "120.0 then 120.0 MB, 20 then 23 open files, 300 then 300 mapped files"),
    ]


def test_what_a_run_does_not_have_is_left_out() -> None:
    assert dict(summary_rows({"completed": False, "fell": True, "completion_time_s": None})) == {
        "outcome": "NOT completed, FELL"
    }


def test_a_run_that_came_too_late_is_told_from_one_that_never_came() -> None:
    assert outcome({**WALK, "completed": False}) == "NOT completed: arrived too late"
    assert outcome({**WALK, "completed": False, "completion_time_s": None}) == "NOT completed"


def test_a_fault_is_named() -> None:
    assert outcome({"completed": False, "fell": False, "fault": "TILT"}) == "NOT completed, FAULT TILT"
    stuck = {"completed": False, "fell": False, "fault": "STUCK_STEERING", "broken": ["front left wheel stuck"]}
    assert outcome(stuck) == "NOT completed, FAULT STUCK_STEERING, front left wheel stuck"


def test_the_title_says_what_was_run(capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(WALK)
    assert capsys.readouterr().out.startswith("uslgo1 · push · FpMW · kalman · seed 3\n")
