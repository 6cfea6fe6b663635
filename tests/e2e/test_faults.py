# SPDX-License-Identifier: Apache-2.0
"""Every fault of the table, injected into a walk at a random phase of the gait; `make faults` tries more phases."""

import os
from pathlib import Path

import numpy as np
import pytest

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble, load_configuration
from sim_bridge.faults.table import ROWS
from sim_bridge.faults.trial import Row, attempt, flaws
from sim_bridge.faults.virtual_campaign import ALL_ROWS

pytestmark = pytest.mark.xdist_group("faults")

PHASES = int(os.environ.get("UGV_FAULT_PHASES", "1"))


@pytest.mark.parametrize("seed", range(PHASES))
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_fault_is_answered_in_time_within_the_joints_limits_and_without_a_stale_command_and_its_log_is_whole(
    row: Row, seed: int, tmp_path: Path
) -> None:
    trial = attempt(row, seed, tmp_path / "log")
    assert flaws(row, trial, load_configuration("uslgo1", row.settings)) == []
    log = Log(tmp_path / "log")
    assert not log.truncated
    for topic in ("/ugv/tick/wbc", "/ugv/tick/mpc"):
        ticks = log.read_signal(topic).values
        assert ticks["index"][0] == 0
        assert (np.diff(ticks["index"]) == 1 + ticks["skipped"][1:]).all()


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


def test_every_row_of_the_table_has_its_own_name() -> None:
    assert len({row.name for row in ALL_ROWS}) == len(ALL_ROWS)
