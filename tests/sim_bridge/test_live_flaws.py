# SPDX-License-Identifier: Apache-2.0
"""A walk against the clock is judged by what explains its faults, and by what its processes keep."""

import pytest

from sim_bridge.live_flaws import LONG_S, flaws

HELD = {"resident_bytes": 100_000_000, "data_bytes": 80_000_000, "open_files": 20, "mapped_files": 300}
IMU = {
    "fault": "STALE_IMU|NO_LEASE",
    "cause": "STALE_IMU",
    "bound": {"loops": ["sim", "link"], "ms": 16.0},
    "stall": {"loop": "sim", "ms": 40.0},
    "stalled_ms": 40.0,
}


def kept(late, early=HELD, duration_s=LONG_S):
    return flaws([], [], "", {"control": {"begun": HELD, "early": early, "late": late}}, duration_s)


def test_only_a_fault_without_a_stall_beyond_its_bound_is_a_flaw():
    tilt = {"fault": "TILT", "cause": "TILT", "bound": None, "stall": None, "stalled_ms": 0.0}
    short = IMU | {"stall": None, "stalled_ms": 12.4}
    assert flaws([IMU, short, tilt], [IMU, short], "TILT", {}, None) == [
        "power was lost to STALE_IMU without a stall of sim or link beyond 16 ms before it, but of 12.4 ms",
        "power was lost to TILT, which no stall of a machine makes",
        "the robot paused for STALE_IMU without a stall of sim or link beyond 16 ms before it, but of 12.4 ms",
    ]


def test_a_run_that_ended_by_a_fault_that_took_no_power_is_told():
    assert flaws([], [], "NO_LEASE", {}, None) == ["the robot never got to stand, and power was not lost: NO_LEASE"]


def test_processes_that_keep_nothing_have_no_flaw():
    assert kept(HELD) == []
    assert kept(HELD | {"resident_bytes": 101_900_000, "open_files": 19, "mapped_files": 299}) == []


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"open_files": 21}, "control holds 21 open files, 20 before"),
        ({"mapped_files": 301}, "control holds 301 mapped files, 300 before"),
        ({"resident_bytes": 102_100_000}, "control holds 2.1 % more memory than after two minutes"),
    ],
)
def test_what_is_kept_is_told(change, sentence):
    assert kept(HELD | change) == [sentence]
    assert kept(HELD | change, duration_s=LONG_S - 1.0) == []
    assert kept(HELD | change, duration_s=None) == []


def test_a_process_that_was_missing_is_told():
    assert kept(None) == kept(HELD, early=None) == ["control was not there all the time"]


@pytest.mark.parametrize("duration_s", [None, 10.0, LONG_S])
def test_memory_that_control_takes_while_its_loops_run_is_told_of_any_run(duration_s):
    buffer = HELD | {"data_bytes": HELD["data_bytes"] + (32 << 20)}
    sentence = "control took 33.6 MB of memory while its loops ran, and was held up filling it"
    assert kept(buffer, duration_s=duration_s) == [sentence]
    assert kept(HELD | {"data_bytes": HELD["data_bytes"] + 4096}, duration_s=duration_s) == []
    others = {"link": {"begun": HELD, "early": HELD, "late": buffer}}
    assert flaws([], [], "", others, duration_s) == []
