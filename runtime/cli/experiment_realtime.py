# SPDX-License-Identifier: Apache-2.0
"""`ugv experiment realtime`: figures against the wall clock beside the spread of those in lockstep."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from runtime.errors import UsageError, unknown
from runtime.recording.spread import Spread, spread_of

Summary = Mapping[str, Any]
SCENARIOS = {"uslgo1": ("flat", "line-6cm", "circle-6cm"), "4ws4wd": ("straight", "s-curve", "figure-eight")}
SEEDS, LEAST_SEEDS = 8, 3
LIVE_SEEDS = 2
"""Runs of each scenario against the wall clock, which take as long as they take, with the first seeds of lockstep."""


class Kind(NamedTuple):
    """A kind of figure.

    Attributes:
        key, part: where it is in a summary.
        scale: from there to the unit of its name.
        resolution: to which it is known, in that unit, by a true pose that is sampled each 10 ms.
    """

    key: str
    part: str | None
    scale: float
    resolution: float


FIGURES = {
    "lateral RMS cm": Kind("lateral_error_m", "rms", 100.0, 0.1),
    "lateral max cm": Kind("lateral_error_m", "max", 100.0, 0.1),
    "mean speed m/s": Kind("speed_mps", "mean", 1.0, 0.001),
    "time to the goal s": Kind("completion_time_s", None, 1.0, 0.02),
}
COMPLETED = "completed"
HEADER = ("scenario", "figure", "lockstep, least", "most", "spread, from", "to", "seed", "real time", "within")


class Comparison(NamedTuple):
    """One figure of one run in real time.

    Attributes:
        scenario, seed: of the run.
        name: of the figure.
        spread: of the figure in lockstep.
        figure: in real time; None if the run has none.
        stall: in words, the stall beyond a fault's bound that the run had; empty without one.
    """

    scenario: str
    seed: int
    name: str
    spread: Spread
    figure: float | None
    stall: str

    @property
    def within(self) -> bool:
        """Whether the figure lies within the spread."""
        return self.figure is not None and self.spread.holds(self.figure)

    @property
    def fails(self) -> bool:
        """Whether it does not, and no stall of the machine explains that."""
        return not self.within and not self.stall


def compared(lockstep: Sequence[Summary], live: Summary) -> list[Comparison]:
    """The figures of a run in real time with those of the same scenario in lockstep, as far as there are any.

    Args:
        lockstep: summaries of the scenario, by several seeds.
        live: that of the run.
    """
    found = []
    for name in (COMPLETED, *FIGURES):
        figures = [figure for figure in (figure_of(summary, name) for summary in lockstep) if figure is not None]
        if len(figures) >= LEAST_SEEDS:
            spread = spread_of(figures, FIGURES[name].resolution if name in FIGURES else 0.0)
            figure = figure_of(live, name)
            found.append(Comparison(live["scenario"], live["seed"], name, spread, figure, stall_of(live)))
    return found


def figure_of(summary: Summary, name: str) -> float | None:
    """A figure of a run: whether it was completed, 1 or 0; or one that only a completed run has, else None."""
    completed = summary["completed"] and not summary["fell"]
    if name == COMPLETED:
        return float(completed)
    kind = FIGURES[name]
    value = summary.get(kind.key) if completed else None
    if kind.part is not None and value is not None:
        value = value.get(kind.part)
    return None if value is None else kind.scale * value


def stall_of(live: Summary) -> str:
    """The first stall of the machine beyond the bound of a fault that then came; empty without one."""
    for fault in (*live["faults"], *live["pauses"]):
        if fault["stall"] is not None:
            stall, bound_ms = fault["stall"], fault["bound"]["ms"]
            return f"{stall['loop']} stalled for {stall['ms']:.3g} ms, beyond the {bound_ms:.3g} ms of {fault['cause']}"
    return ""


def run_realtime(robot: str, scenarios: Sequence[str], seeds: int, out: Path | None) -> int:
    """Run scenarios both ways and print the table; 1 if a run in real time differs and no stall explains it.

    Args:
        robot: its name.
        scenarios: names; none for a few of the robot's own.
        seeds: runs of each in lockstep.
        out: new directory in which the runs in real time are kept, if they are to be.

    Raises:
        UsageError: for an unknown robot, or too few seeds to have a spread.
    """
    from runtime.cli.console import print_table

    if robot not in SCENARIOS:
        raise UsageError("ugv experiment: " + unknown("robot", robot, SCENARIOS))
    if seeds < LEAST_SEEDS:
        raise UsageError(f"ugv experiment: --seeds {seeds} is below the {LEAST_SEEDS} that a spread takes")
    chosen = tuple(scenarios) or SCENARIOS[robot]
    lockstep = _in_lockstep(robot, chosen, seeds)
    lives = _in_real_time(robot, chosen, out)
    found = [one for live in lives for one in compared(lockstep[live["scenario"]], live)]
    title = f"{robot} against the wall clock, beside {seeds} seeds in lockstep"
    print_table(title, HEADER, [_row(one) for one in found])
    for live in lives:
        for sentence in (stall_of(live), *live["flaws"]):
            if sentence:
                print(f"{live['scenario']}, seed {live['seed']}: {sentence}")
    for scenario in chosen:
        if not any(one.within or one.fails for one in found if one.scenario == scenario):
            print(f"{scenario}: not shown, since this machine stalled in each run")
    return 1 if any(one.fails for one in found) or any(live["flaws"] for live in lives) else 0


def _in_lockstep(robot: str, scenarios: Sequence[str], seeds: int) -> dict[str, Sequence[Summary]]:
    """Summaries by scenario."""
    from runtime.cli.batch import Job, run_jobs
    from runtime.cli.console import progress_bar

    jobs = [Job(scenario, seed, robot=robot) for scenario in scenarios for seed in range(seeds)]
    with progress_bar("lockstep") as progress:
        done = iter(run_jobs(jobs, progress))
    return {scenario: [next(done) for _ in range(seeds)] for scenario in scenarios}


def _in_real_time(robot: str, scenarios: Sequence[str], out: Path | None) -> list[Summary]:
    """Summaries, one run at a time."""
    from runtime.cli import sil
    from runtime.cli.console import progress_bar
    from runtime.cli.output import run_directory

    done: list[Summary] = []
    with tempfile.TemporaryDirectory(prefix="ugv-realtime-") as passing:
        for scenario in scenarios:
            for seed in range(LIVE_SEEDS):
                name = f"{robot}-{Path(scenario).stem}-{seed}"
                with (
                    run_directory((out or Path(passing)) / name, name) as directory,
                    progress_bar(f"{scenario}, seed {seed}") as progress,
                ):
                    done.append(sil.simulate_live(robot, scenario, seed=seed, out=directory, progress=progress))
    return done


def _row(one: Comparison) -> tuple[Any, ...]:
    spread = one.spread
    within = "yes" if one.within else "NO" if one.fails else "no, it stalled"
    return (
        one.scenario,
        one.name,
        spread.least,
        spread.most,
        spread.low,
        spread.high,
        one.seed,
        one.figure,
        within,
    )
