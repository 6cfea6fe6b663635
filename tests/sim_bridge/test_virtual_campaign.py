# SPDX-License-Identifier: Apache-2.0
"""A trial in virtual time has not passed if its log lacks a tick."""

import pytest

from sim_bridge.faults import virtual_campaign
from sim_bridge.faults.table import ROWS
from sim_bridge.faults.trial import Trial
from sim_bridge.faults.virtual_campaign import tried

ROW = next(row for row in ROWS if row.name == "emergency stop")


@pytest.mark.parametrize(
    ("indices", "places"), [(range(20), 0), ((0, 1, 2, 5, 6, 9), 2), (range(1, 20), 1), ((0, 1, 1, 2), 1)]
)
def test_a_log_of_a_fault_that_lacks_ticks_is_a_flaw_at_every_phase(monkeypatch, write_bag, indices, places):
    def attempt(row, seed, out):
        write_bag(out, indices)
        return Trial(row.answer, 0, row.fault, 1, True, 0, True, False)

    monkeypatch.setattr(virtual_campaign, "attempt", attempt)
    for seed in range(3):
        flaws = tried(ROW, seed)[1]
        assert flaws == ([f"ticks of wbc are missing in the log at {places} places"] if places else [])


def test_a_log_that_was_cut_off_is_a_flaw(monkeypatch, write_bag):
    def attempt(row, seed, out):
        (file,) = write_bag(out, range(2000)).glob("*.mcap")
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        return Trial(row.answer, 0, row.fault, 1, True, 0, True, False)

    monkeypatch.setattr(virtual_campaign, "attempt", attempt)
    assert "the log was cut off" in tried(ROW, 0)[1][0]
