# SPDX-License-Identifier: Apache-2.0
"""Every fault of the vehicle's table, injected into a drive at a random time; `make faults` tries more times."""

from pathlib import Path

import pytest

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.drive import DriveRow
from sim_bridge.faults.vehicle_table import VEHICLE_ROWS
from sim_bridge.faults.virtual_campaign import tried

pytestmark = pytest.mark.xdist_group("vehicle_faults")


@pytest.mark.parametrize("row", VEHICLE_ROWS, ids=lambda row: row.name)
def test_a_fault_is_answered_in_time_within_the_wheels_limits_and_without_a_stale_command_and_its_log_is_whole(
    row: DriveRow,
) -> None:
    assert tried(row, 0)[1] == []


REPLAYED = ("control unit silent", "IMU time backwards", "under-voltage", "drive loop overruns, 5 in a row")


@pytest.mark.parametrize("name", REPLAYED)
def test_the_log_of_a_fault_is_whole(name: str, tmp_path: Path) -> None:
    (row,) = (row for row in VEHICLE_ROWS if row.name == name)
    attempt(row, 0, tmp_path / "log")
    log = Log(tmp_path / "log")
    result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    assert not result.notes
    verdicts = {name: task.verdict for name, task in result.tasks.items()}
    assert set(verdicts.values()) == {"identical"}, verdicts
