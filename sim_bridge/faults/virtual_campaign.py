# SPDX-License-Identifier: Apache-2.0
"""Every fault that virtual time can have, by robot: of wires, sensors and loops, and of the computer."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from runtime.recording.log import Log
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.computer_table import COMPUTER_ROWS
from sim_bridge.faults.computer_trial import ComputerRow, attempt_on_computer
from sim_bridge.faults.log_flaws import holes
from sim_bridge.faults.row import Row
from sim_bridge.faults.table import ROWS
from sim_bridge.faults.trial import Trial, flaws
from sim_bridge.faults.vehicle_table import VEHICLE_ROWS

AnyRow = Row[Any, Any] | ComputerRow
TABLES: dict[str, tuple[AnyRow, ...]] = {"uslgo1": (*ROWS, *COMPUTER_ROWS), "4ws4wd": VEHICLE_ROWS}


def tried(row: AnyRow, seed: int) -> tuple[Trial, list[str]]:
    """Try a fault at the time that a seed chooses; gives what came of it, and what is wrong with that.

    The log is part of it: it is to be whole.
    """
    with TemporaryDirectory(prefix="ugv-fault-") as directory:
        if not isinstance(row, Row):
            return attempt_on_computer(row, seed, Path(directory))
        out = Path(directory) / "log"
        trial = attempt(row, seed, out)
        return trial, flaws(row, trial, row.config) + holes(Log(out))
