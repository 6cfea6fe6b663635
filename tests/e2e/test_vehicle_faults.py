# SPDX-License-Identifier: Apache-2.0
"""Every fault of the vehicle's table, injected into a drive at a random time; `make faults` tries more times."""

import os
from pathlib import Path

import numpy as np
import pytest

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.drive import DriveRow
from sim_bridge.faults.trial import flaws
from sim_bridge.faults.vehicle_table import VEHICLE_ROWS

pytestmark = pytest.mark.xdist_group("vehicle_faults")

PHASES = int(os.environ.get("UGV_FAULT_PHASES", "1"))


@pytest.mark.parametrize("seed", range(PHASES))
@pytest.mark.parametrize("row", VEHICLE_ROWS, ids=lambda row: row.name)
def test_a_fault_is_answered_in_time_within_the_wheels_limits_and_without_a_stale_command_and_its_log_is_whole(
    row: DriveRow, seed: int, tmp_path: Path
) -> None:
    trial = attempt(row, seed, tmp_path / "log")
    assert flaws(row, trial, row.config) == []
    log = Log(tmp_path / "log")
    assert not log.truncated
    ticks = log.read_signal("/ugv/tick/drive").values
    assert ticks["index"][0] == 0
    assert (np.diff(ticks["index"]) == 1 + ticks["skipped"][1:]).all()


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
