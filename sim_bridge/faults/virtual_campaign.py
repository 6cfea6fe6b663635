# SPDX-License-Identifier: Apache-2.0
"""Every fault that virtual time can have: of wires and sensors, and of the computer."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from runtime.recording.log import Log
from runtime.robots import load_configuration
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.faults.computer_table import COMPUTER_ROWS
from sim_bridge.faults.computer_trial import ComputerRow, attempt_on_computer
from sim_bridge.faults.log_flaws import holes
from sim_bridge.faults.table import ROWS
from sim_bridge.faults.trial import Row, Trial, attempt, flaws

ALL_ROWS: tuple[Row | ComputerRow, ...] = (*ROWS, *COMPUTER_ROWS)


def configuration_of(row: Row | ComputerRow) -> Uslgo1Config:
    """The configuration that a fault is tried with."""
    config = load_configuration("uslgo1", row.settings)
    assert isinstance(config, Uslgo1Config)
    return config


def tried(row: Row | ComputerRow, seed: int) -> tuple[Trial, list[str]]:
    """Try a fault at the phase of the gait that a seed chooses; gives what came of it, and what is wrong with that.

    The log is part of it: it is to be whole.
    """
    with TemporaryDirectory(prefix="ugv-fault-") as directory:
        if not isinstance(row, Row):
            return attempt_on_computer(row, seed, Path(directory))
        out = Path(directory) / "log"
        trial = attempt(row, seed, out)
        return trial, flaws(row, trial, configuration_of(row)) + holes(Log(out))
