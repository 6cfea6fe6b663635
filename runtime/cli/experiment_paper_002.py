# SPDX-License-Identifier: Apache-2.0
"""`ugv experiment paper-002`: the paper's straight and curves by several methods, on several plants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_bridge.paper_002.results import Results
    from sim_bridge.paper_002.tables import Table

NAME = "paper-002"
KINEMATIC, MUJOCO = "kinematic", "mujoco"
PLANTS = (KINEMATIC, MUJOCO)


def run_paper_002(plants: Sequence[str], seeds: int, out: Path | None) -> int:
    """Compare the methods, print the tables and write the report.

    What the paper's and the peers' methods do is reported as it comes out; the exit code is that of the claims made
    for ours, and 0 without the kinematic plants, which they are made on.

    Args:
        plants: of `PLANTS`, which to drive on.
        seeds: drives of each comparison in MuJoCo; the kinematic plants have no chance in them.
        out: directory of the report; None for the next free one below `runs/`.
    """
    from runtime.cli.console import print_table
    from runtime.cli.output import run_directory
    from sim_bridge.paper_002.claims import claims
    from sim_bridge.paper_002.findings import findings
    from sim_bridge.paper_002.pictures import pictures
    from sim_bridge.paper_002.report import write_report
    from sim_bridge.paper_002.tables import claim_table, kinematic_tables

    with run_directory(out, NAME) as directory:
        results = drive_kinematic() if KINEMATIC in plants else None
        tables = [] if results is None else [claim_table(results), *kinematic_tables(results)]
        tables += [drive_mujoco(seeds)] if MUJOCO in plants else []
        found = [] if results is None else findings(results)
        figures = [] if results is None else pictures(results)
        facts = [*plants, *([f"{seeds} seed{'' if seeds == 1 else 's'} in MuJoCo"] if MUJOCO in plants else [])]
        report = write_report(directory, facts, found, tables, figures)
    for table in [*tables[1:], *tables[:1]]:
        print_table(table.title, table.header, table.rows)
    for sentence in found:
        print(f"- {sentence}")
    print(f"report: {report}")
    missed = [] if results is None else [claim for claim in claims(results) if claim.decides and not claim.kept]
    return 1 if missed else 0


def drive_kinematic() -> Results:
    """Every contender on every course and kinematic plant."""
    from runtime.cli.batch import in_processes
    from runtime.cli.console import progress_bar
    from sim_bridge.paper_002.results import Results, all_trials
    from sim_bridge.paper_002.trial import drive

    with progress_bar(f"{NAME}, {KINEMATIC}") as progress:
        return Results(in_processes(drive, all_trials(), progress))


def drive_mujoco(seeds: int) -> Table:
    """Every contender that the vehicle can have, on the simulated vehicle."""
    from runtime.cli.batch import Job, run_jobs
    from runtime.cli.console import progress_bar
    from sim_bridge.paper_002.contenders import ROBOT
    from sim_bridge.paper_002.vehicle import all_drives, settings_of, vehicle_table

    drives = all_drives(seeds)
    jobs = [
        Job(drive.scenario, drive.seed, None, drive.contender.controller, settings_of(drive), ROBOT) for drive in drives
    ]
    with progress_bar(f"{NAME}, {MUJOCO}") as progress:
        return vehicle_table(list(zip(drives, run_jobs(jobs, progress), strict=True)))
