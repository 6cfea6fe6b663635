# SPDX-License-Identifier: Apache-2.0
"""`ugv experiment paper-002`: the paper's straight and curves by several methods, on several plants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from runtime.recording.figure_style import ReportFigure
    from sim_bridge.paper_002.claims import Claim
    from sim_bridge.paper_002.results import Results
    from sim_bridge.paper_002.tables import Table

NAME = "paper-002"
KINEMATIC, MUJOCO = "kinematic", "mujoco"
PLANTS = (KINEMATIC, MUJOCO)


class Part(NamedTuple):
    """What one kind of plant brings to the report."""

    claims: Sequence[Claim]
    tables: Sequence[Table]
    findings: Sequence[str]
    figures: Sequence[ReportFigure]


def run_paper_002(plants: Sequence[str], seeds: int, quick: bool, out: Path | None) -> int:
    """Compare the methods, print the tables and write the report.

    What the paper's and the peers' methods do is reported as it comes out; the exit code is that of the claims made
    for ours: their figures on the kinematic plants, and that it completes every drive in MuJoCo.

    Args:
        plants: of `PLANTS`, which to drive on.
        seeds: drives of each comparison in MuJoCo; the kinematic plants have no chance in them.
        quick: in MuJoCo only the few drives that tell most.
        out: directory of the report; None for the next free one below `runs/`.
    """
    from runtime.cli.console import print_table
    from runtime.cli.output import run_directory
    from sim_bridge.paper_002.report import write_report
    from sim_bridge.paper_002.tables import claim_table

    with run_directory(out, NAME) as directory:
        parts = [on_kinematic_plants()] if KINEMATIC in plants else []
        parts += [in_mujoco(seeds, quick)] if MUJOCO in plants else []
        claims = [claim for part in parts for claim in part.claims]
        tables = [table for part in parts for table in part.tables]
        found = [sentence for part in parts for sentence in part.findings]
        figures = [figure for part in parts for figure in part.figures]
        facts = [*plants, *([f"{seeds} seed{'' if seeds == 1 else 's'} in MuJoCo"] if MUJOCO in plants else [])]
        report = write_report(directory, facts, found, [claim_table(claims), *tables], figures)
    for table in [*tables, claim_table(claims)]:
        print_table(table.title, table.header, table.rows)
    for sentence in found:
        print(f"- {sentence}")
    print(f"report: {report}")
    return 1 if any(claim.decides and not claim.kept for claim in claims) else 0


def on_kinematic_plants() -> Part:
    """Every contender on every course and kinematic plant."""
    from sim_bridge.paper_002.claims import claims
    from sim_bridge.paper_002.findings import findings
    from sim_bridge.paper_002.pictures import pictures
    from sim_bridge.paper_002.tables import kinematic_tables

    results = drive_kinematic()
    return Part(claims(results), kinematic_tables(results), findings(results), pictures(results))


def drive_kinematic() -> Results:
    """Drive them."""
    from runtime.cli.batch import in_processes
    from runtime.cli.console import progress_bar
    from sim_bridge.paper_002.results import Results, all_trials
    from sim_bridge.paper_002.trial import drive

    with progress_bar(f"{NAME}, {KINEMATIC}") as progress:
        return Results(in_processes(drive, all_trials(), progress))


def in_mujoco(seeds: int, quick: bool) -> Part:
    """Every contender that the vehicle can have, on the simulated vehicle."""
    from runtime.cli.batch import in_processes
    from runtime.cli.console import progress_bar
    from sim_bridge.paper_002.vehicle import all_drives, few_drives, vehicle_claims, vehicle_table
    from sim_bridge.paper_002.vehicle_drive import driven
    from sim_bridge.paper_002.vehicle_pictures import vehicle_pictures

    drives = few_drives(seeds) if quick else all_drives(seeds)
    with progress_bar(f"{NAME}, {MUJOCO}") as progress:
        outcomes = in_processes(driven, drives, progress)
    judged = [(outcome.drive, outcome.summary) for outcome in outcomes]
    return Part(vehicle_claims(judged), [vehicle_table(judged)], [], vehicle_pictures(outcomes))
