# SPDX-License-Identifier: Apache-2.0
"""A walk against the clock is judged by what explains its faults, and by what its processes keep."""

import pytest

from sim_bridge.live_flaws import LONG_S, flaws

HELD = {"resident_bytes": 100_000_000, "open_files": 20, "mapped_files": 300}
STALL = {"loop": "wbc", "ms": 40.0}


def kept(late, early=HELD, duration_s=LONG_S):
    return flaws([], {"control": {"early": early, "late": late}}, duration_s)


def test_only_a_fault_without_a_stall_is_a_flaw():
    faults = [{"fault": "STALE_IMU", "stall": STALL}, {"fault": "TILT", "stall": None}]
    assert flaws(faults, {}, None) == ["power was lost to TILT without a stall of this machine before it"]


def test_processes_that_keep_nothing_have_no_flaw():
    assert kept(HELD) == []
    assert kept({"resident_bytes": 101_900_000, "open_files": 19, "mapped_files": 299}) == []


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
