# SPDX-License-Identifier: Apache-2.0
"""`ugv experiment faults`: what robots do about each fault, beside what they are to do."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from runtime.errors import UsageError, unknown

if TYPE_CHECKING:
    from sim_bridge.faults.live_campaign import Campaign

LIVE_ROBOT = "uslgo1"
LIVE_HEADER = ("fault", "answer expected", "seen", "within ms", "took ms", "joints", "spoiled by stalls", "verdict")
HEADER = ("fault", "answer expected", "seen", "within ms", "took ms", "limits", "verdict")


class Outcome(NamedTuple):
    """Trials of one fault at several times.

    Attributes:
        name, expected: of the fault, and its answer.
        seen: the answer, or the first that differs.
        bound_ms, worst_ms: how soon it is due, and when it came at the latest.
        limits_kept: whether no joint or wheel passed its limits before the robot was damped.
        flaws: all that was not as it is to be, with the seed.
    """

    name: str
    expected: str
    seen: str
    bound_ms: float
    worst_ms: float
    limits_kept: bool
    flaws: tuple[str, ...]


def try_fault(place: tuple[str, int], seeds: Sequence[int]) -> Outcome:
    """Try one row of a robot's table at the times that the seeds choose."""
    from sim_bridge.faults.virtual_campaign import TABLES, tried

    robot, number = place
    row = TABLES[robot][number]
    trials, flaws = zip(*(tried(row, seed) for seed in seeds), strict=True)
    different = [trial for trial in trials if trial.answer != row.answer]
    return Outcome(
        row.name,
        ", ".join(row.answer),
        ", ".join((different or trials)[0].answer),
        row.bound_ns(row.config) * 1e-6,
        max(trial.time_ns for trial in trials) * 1e-6,
        all(trial.limits_kept for trial in trials),
        tuple(f"seed {seed}: {flaw}" for seed, found in zip(seeds, flaws, strict=True) for flaw in found),
    )


def run_faults(robot: str | None, times: int) -> int:
    """Try every fault of a robot, or of all, at some times and print the tables; 1 if any is not as it is to be.

    Raises:
        UsageError: for an unknown robot.
    """
    from runtime.cli.batch import in_processes
    from runtime.cli.console import print_table, progress_bar
    from sim_bridge.faults.virtual_campaign import TABLES

    robots = tuple(TABLES) if robot is None else (robot,)
    if robot not in (None, *TABLES):
        raise UsageError("ugv experiment: " + unknown("robot", robots[0], tuple(TABLES)))
    places = [(name, number) for name in robots for number in range(len(TABLES[name]))]
    with progress_bar("faults") as progress:
        outcomes = in_processes(partial(try_fault, seeds=range(times)), places, progress)
    for name in robots:
        own = [outcome for outcome, (of, _) in zip(outcomes, places, strict=True) if of == name]
        title = f"Faults of {name}, each at {times} random time{'' if times == 1 else 's'} while it is under way"
        print_table(title, HEADER, [_row(outcome) for outcome in own])
        for outcome in own:
            for flaw in outcome.flaws:
                print(f"{name}: {outcome.name}, {flaw}")
    return 1 if any(outcome.flaws for outcome in outcomes) else 0


def run_live_faults(robot: str | None, phases: int, only: str, out: Path | None) -> int:
    """Try the faults in real time and print the table; 1 if anything is not as it is to be, or was not shown.

    Raises:
        UsageError: for a robot that has no such table, or an unknown fault.
    """
    from runtime.cli.console import print_table, progress_bar
    from sim_bridge.faults.live_campaign import campaign
    from sim_bridge.faults.live_table import LIVE_ROWS

    if robot not in (None, LIVE_ROBOT):
        raise UsageError(f"ugv experiment: faults in real time are tried with {LIVE_ROBOT} only, not with {robot}")
    rows = [row for row in LIVE_ROWS if only in row.name]
    if not rows:
        raise UsageError("ugv experiment: " + unknown("fault", only, [row.name for row in LIVE_ROWS]))
    tried: list[str] = []
    with progress_bar("faults") as progress:

        def told(what: str) -> None:
            tried.append(what)
            progress(len(tried), max(len(rows) * phases, len(tried) + 1))

        done = campaign(rows, phases, 0, out, told)
    title = f"Faults in real time, each at {phases} random phase{'' if phases == 1 else 's'} of the trot"
    print_table(title, LIVE_HEADER, [_live_row(row.name, done) for row in rows])
    wrong = 0
    for row in rows:
        for verdict in done.verdicts[row.name]:
            wrong += bool(verdict.flaws) and not verdict.shows_nothing
            for flaw in verdict.flaws:
                print(f"{row.name}: {flaw}" + (f" (a stall of {verdict.stall_ms:.0f} ms)" if verdict.stall_ms else ""))
        wrong += not done.shown(row.name) and row.name not in done.untried
    for name, reason in done.untried.items():
        print(f"{name}: not tried, {reason}")
    for flaw in done.flaws:
        print(flaw)
    return 1 if wrong or done.flaws else 0


def _live_row(name: str, done: Campaign) -> tuple[Any, ...]:
    """A row of the table: the first trial that differs, or else the one that took longest."""
    trials, shown = done.verdicts[name], done.shown(name)
    if not trials:
        return (name, None, None, None, None, None, 0, "not tried")
    chosen = max(shown or trials, key=lambda verdict: (bool(verdict.flaws), verdict.time_ms))
    judgement = "as expected" if not chosen.flaws else "DIFFERS" if shown else "NOT SHOWN"
    return (
        name,
        ", ".join(chosen.expected),
        ", ".join(chosen.answer),
        round(chosen.bound_ms),
        round(chosen.time_ms),
        "kept" if chosen.joints_kept else "PASSED",
        sum(verdict.shows_nothing for verdict in trials),
        judgement,
    )


def _row(outcome: Outcome) -> tuple[Any, ...]:
    return (
        outcome.name,
        outcome.expected,
        outcome.seen,
        round(outcome.bound_ms),
        round(outcome.worst_ms),
        "kept" if outcome.limits_kept else "PASSED",
        "DIFFERS" if outcome.flaws else "as expected",
    )
