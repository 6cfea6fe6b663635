# SPDX-License-Identifier: Apache-2.0
"""Every fault of processes, network, disk and clocks in a walk in virtual time; `make faults` tries more phases."""

from pathlib import Path

import pytest

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.robots import assemble
from sim_bridge.faults.computer_table import COMPUTER_ROWS
from sim_bridge.faults.computer_trial import ComputerRow, attempt_on_computer

pytestmark = pytest.mark.xdist_group("computer faults")


@pytest.mark.parametrize("row", COMPUTER_ROWS, ids=lambda row: row.name)
def test_a_fault_of_the_computer_is_answered_in_time_and_told_and_no_tick_is_lost_uncounted(
    row: ComputerRow, tmp_path: Path
) -> None:
    _, flaws = attempt_on_computer(row, 0, tmp_path)
    assert flaws == []


REPLAYED = {"control stopped for 0.5 s": 1, "control killed": 2, "suspended for 1 s": 1, "recorder killed": 2}


@pytest.mark.parametrize("name", REPLAYED)
def test_every_log_of_such_a_walk_replays(name: str, tmp_path: Path) -> None:
    (row,) = (row for row in COMPUTER_ROWS if row.name == name)
    attempt_on_computer(row, 1, tmp_path)
    bags = sorted((tmp_path / "logs").iterdir())
    assert len(bags) == REPLAYED[name]
    for bag in bags:
        log = Log(bag)
        result = Replay(log, assemble(log.robot, log.config), log.robot).run()
        assert {task.verdict for task in result.tasks.values()} == {"identical"}
