# SPDX-License-Identifier: Apache-2.0
"""Every fault of the tables, injected at a random time into a robot under way; `make faults` tries more times."""

from pathlib import Path
from typing import Any

import pytest

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.row import Row
from sim_bridge.faults.table import ROWS
from sim_bridge.faults.vehicle_table import VEHICLE_ROWS
from sim_bridge.faults.virtual_campaign import TABLES, tried

REPLAYED = {
    "uslgo1": ("replies missing", "IMU time backwards", "MPC hung", "WBC overruns, 5 in a row", "emergency stop"),
    "4ws4wd": ("control unit silent", "IMU time backwards", "under-voltage", "drive loop overruns, 5 in a row"),
}


def of_a_robot(row: Row[Any, Any]) -> Any:
    """A row as a parameter; those of one robot share its kernels, and so a process."""
    return pytest.param(row, id=f"{row.robot}, {row.name}", marks=pytest.mark.xdist_group(f"faults of {row.robot}"))


@pytest.mark.parametrize("row", [of_a_robot(row) for row in (*ROWS, *VEHICLE_ROWS)])
def test_a_fault_is_answered_in_time_within_the_limits_and_without_a_stale_command_and_its_log_is_whole(
    row: Row[Any, Any],
) -> None:
    assert tried(row, 0)[1] == []


@pytest.mark.parametrize("row", [of_a_robot(row) for row in (*ROWS, *VEHICLE_ROWS) if row.name in REPLAYED[row.robot]])
def test_the_log_of_a_fault_is_whole(row: Row[Any, Any], tmp_path: Path) -> None:
    attempt(row, 0, tmp_path / "log")
    log = Log(tmp_path / "log")
    result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    assert result.identical
    assert not result.notes
    assert {task.verdict for task in result.tasks.values()} == {"identical"}


@pytest.mark.parametrize("robot", TABLES)
def test_every_row_of_a_table_has_its_own_name(robot: str) -> None:
    assert len({row.name for row in TABLES[robot]}) == len(TABLES[robot])


@pytest.mark.parametrize("robot", REPLAYED)
def test_every_log_that_is_to_be_replayed_is_of_a_row(robot: str) -> None:
    assert set(REPLAYED[robot]) <= {row.name for row in TABLES[robot]}
