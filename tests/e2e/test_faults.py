# SPDX-License-Identifier: Apache-2.0
"""Every fault of the table, injected into a walk at a random phase of the gait; `make faults` tries more phases."""

from pathlib import Path

import pytest

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.table import ROWS
from sim_bridge.faults.virtual_campaign import TABLES, tried
from sim_bridge.faults.walk import WalkRow

pytestmark = pytest.mark.xdist_group("faults")


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_fault_is_answered_in_time_within_the_joints_limits_and_without_a_stale_command_and_its_log_is_whole(
    row: WalkRow,
) -> None:
    assert tried(row, 0)[1] == []


REPLAYED = ("replies missing", "IMU time backwards", "MPC hung", "WBC overruns, 5 in a row", "emergency stop")


@pytest.mark.parametrize("name", REPLAYED)
def test_the_log_of_a_fault_is_whole(name: str, tmp_path: Path) -> None:
    (row,) = (row for row in ROWS if row.name == name)
    attempt(row, 0, tmp_path / "log")
    log = Log(tmp_path / "log")
    result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    assert result.identical
    assert not result.notes
    assert {task.verdict for task in result.tasks.values()} == {"identical"}


@pytest.mark.parametrize("robot", TABLES)
def test_every_row_of_a_table_has_its_own_name(robot: str) -> None:
    assert len({row.name for row in TABLES[robot]}) == len(TABLES[robot])
