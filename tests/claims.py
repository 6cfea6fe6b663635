# SPDX-License-Identifier: Apache-2.0
"""Runs the scenarios and compares with what is claimed: `make claims`, on a few seeds so that a change is seen.

`python tests/claims.py --full` runs the seeds that the claims are made for. Exit code 1 if a bound is missed; times are
printed, and never decide, since they depend on the machine.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.cli.batch import Job, Summary, run_jobs
from runtime.cli.console import print_table, progress_bar
from runtime.cli.main import single_threaded
from runtime.errors import UgvError

SPEED_KEY = "scenario.speed_mps"
IMPULSE_KEY = "scenario.push_impulse_n_s"
FASTEST_TROTS_MPS = (1.2, 1.5)
STEADY_TROT_S = 10.0
PUSHES = 8 * 4 * 5  # directions, gait phases, repetitions: the seed of `push` counts through them
A_FEW_PUSHES = 5  # every 5th seed: all directions, all phases
DETERMINISM = ("turn", 3)  # scenario and seed
DRIVES = ("straight", "curve", "s-curve", "figure-eight", "crab", "spin", "reverse", "slalom")
LATE = {
    "simulation.command_delay_ns": "300000000",
    "safety.steering_stuck_ns": "1000000000",
    "safety.refusal_ns": "1000000000",
}
"""Commands that take 0.3 s to the wheels, and a watch that knows of it."""

BOLD = {SPEED_KEY: "3", "tracker.following.speed.lateral_acceleration_mps2": "4.41"}
"""Counts on half of the grip of the ground, 0.5 mu g, which is more than the slippery patch has."""
SPUN_RAD = 0.7

Measure = Callable[[Sequence[Summary]], float]


@dataclass(frozen=True)
class Claim:
    """A figure over some runs, and the bound that it has to keep.

    Attributes:
        name: what is claimed.
        jobs: the runs that it is measured on.
        measure: makes the figure of their summaries.
        bound: the largest (or, with `at_least`, the smallest) figure that keeps the claim; None to report only.
        aim: what the figure should become.
        decides: false for figures that depend on the machine.
    """

    name: str
    jobs: tuple[Job, ...]
    measure: Measure
    bound: float | None
    aim: float | None
    at_least: bool = False
    decides: bool = True

    def kept(self, figure: float) -> bool:
        """Whether the figure keeps the bound; NaN never does."""
        if self.bound is None:
            return True
        return figure >= self.bound if self.at_least else figure <= self.bound


def completed(summaries: Sequence[Summary]) -> float:
    """Runs that reached the goal without a fall."""
    return sum(bool(summary["completed"]) and not summary["fell"] for summary in summaries)


def pushes_withstood(summaries: Sequence[Summary]) -> float:
    """Runs that were not felled by the push, were back at speed in 3 s, and back on the path in 5 s."""
    return sum(bool(s.get("push", {}).get("passed") and s["push"]["back_at_speed"]) for s in summaries)


def worst(*keys: str) -> Measure:
    """The largest of one key of the summaries; infinite if a run was not completed or has no such figure."""

    def measure(summaries: Sequence[Summary]) -> float:
        return max(_figure(summary, keys) for summary in summaries)

    return measure


def least(key: str) -> Measure:
    """The smallest of one key."""
    return lambda summaries: min(summary[key] for summary in summaries)


def speed_deviation(summaries: Sequence[Summary]) -> float:
    """Largest deviation of the mean speed from the commanded one, as a part of it."""
    return max(
        abs(_figure(summary, ("speed_mps", "mean")) / summary["speed_mps"]["commanded"] - 1.0) for summary in summaries
    )


def slowed_to(summaries: Sequence[Summary]) -> float:
    """The largest part that is left, on the patch, of the speed with which it was entered."""
    return max(
        _figure(summary, ("patch", "speed_least_mps")) / summary["patch"]["speed_entry_mps"] for summary in summaries
    )


def mean_of_completed(summaries: Sequence[Summary]) -> float:
    """Mean tracking error over the runs; infinite if one was not completed."""
    return sum(_figure(summary, ("tracking_error_m", "mean")) for summary in summaries) / len(summaries)


def _figure(summary: Summary, keys: Sequence[str]) -> float:
    value: Any = summary if summary["completed"] else None
    for key in keys:
        value = None if value is None else value[key]
    return math.inf if value is None or math.isnan(value) else float(value)


def run_of_hash_seed(hash_seed: str, directory: Path) -> None:
    """Record one run in a process with the given PYTHONHASHSEED."""
    scenario, seed = DETERMINISM
    command = ["-m", "runtime.cli.main", "sil", "uslgo1", scenario, "--seed", str(seed), "--out", str(directory)]
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    done = subprocess.run([sys.executable, *command], env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise UgvError(f"{' '.join(command)} ended with code {done.returncode}: {done.stderr.strip()[-300:]}")


def recorded_difference(_: Sequence[Summary]) -> float:
    """Whether two runs of one seed, under different PYTHONHASHSEED, differ in any bit of any signal."""
    from runtime.recording.compare import first_log_difference
    from runtime.recording.log import Log

    with tempfile.TemporaryDirectory(prefix="ugv-claims-") as parent:
        one, other = Path(parent) / "one", Path(parent) / "other"
        run_of_hash_seed("1", one)
        run_of_hash_seed("2", other)
        difference = first_log_difference(Log(one), Log(other))
    if difference is not None:
        print(f"claims: {difference}", file=sys.stderr)
    return float(difference is not None)


def replayed_difference(_: Sequence[Summary]) -> float:
    """Tasks of which a replay in a fresh process does not say that they are identical."""
    from runtime.recording.log import Log
    from runtime.recording.replay import Replay
    from runtime.robots import assemble

    with tempfile.TemporaryDirectory(prefix="ugv-claims-") as parent:
        run_of_hash_seed("0", Path(parent) / "run")
        log = Log(Path(parent) / "run")
        result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    for task in result.tasks.values():
        if task.verdict != "identical":
            print(f"claims: {task.task}: {task.verdict}", file=sys.stderr)
    return float(sum(task.verdict != "identical" for task in result.tasks.values()) + len(result.damage))


def paper_002_missed(_: Sequence[Summary]) -> float:
    """Claims of paper 002 that the kinematic plants do not bear out."""
    from runtime.cli.experiment_paper_002 import drive_kinematic
    from sim_bridge.paper_002.claims import claims as made_of

    missed = [claim for claim in made_of(drive_kinematic()) if claim.decides and not claim.kept]
    for claim in missed:
        print(f"claims: {claim.what}: {claim.measured:.4g} is above {claim.at_least:g}", file=sys.stderr)
    return float(len(missed))


def tracker_step_p99_ms(_: Sequence[Summary]) -> float:
    """Time of the step of the vehicle's tracker with its own controller, as `ugv bench tracker` measures it."""
    from runtime.cli.bench import percentiles
    from runtime.cli.bench_tracker import controllers, step_times_ms

    _, p99, _ = percentiles(step_times_ms(controllers()[0]))
    return p99


def straight(speed_mps: float) -> str:
    """A straight that is walked for ten seconds at a speed, besides a metre and a half at either end."""
    return f"straight-{math.ceil(STEADY_TROT_S * speed_mps + 3.0)}"


def claims(full: bool) -> list[Claim]:
    """The table, on the seeds it is claimed for or on a few."""
    lines = range(20 if full else 3)
    others = range(10 if full else 1)
    pushes = range(0, PUSHES, 1 if full else A_FEW_PUSHES)
    trots = range(5 if full else 1)

    def jobs(scenario: str, seeds: range, **options: Any) -> tuple[Job, ...]:
        return tuple(Job(scenario, seed, **options) for seed in seeds)

    line_3, line_6 = jobs("line-3cm", lines), jobs("line-6cm", lines)
    circle, curve = jobs("circle-6cm", range(len(others))), jobs("s-curve", others)
    walks = line_3 + line_6
    rms = worst("lateral_error_m", "rms")
    table = [Claim("lines: completed", walks, completed, len(walks), len(walks), at_least=True)]
    for scenario, bound, aim in (
        ("flat", 0.01, 0.005),
        ("line-3cm", 0.01, 0.005),
        ("line-6cm", 0.015, 0.008),
        ("circle-6cm", 0.04, 0.02),
    ):
        truth = jobs(scenario, others, estimator="truth")
        table.append(Claim(f"{scenario}, truth: lateral RMS m", truth, rms, bound, aim))
    for name, runs, bound, aim in (
        ("line-3cm", line_3, 0.03, 0.02),
        ("line-6cm", line_6, 0.04, 0.025),
        ("circle-6cm", circle, 0.05, 0.03),
    ):
        table.append(Claim(f"{name}: lateral RMS m", runs, rms, bound, aim))
    slower, faster = (jobs(straight(v), trots, overrides={SPEED_KEY: str(v)}) for v in FASTEST_TROTS_MPS)
    push = jobs("push", pushes, overrides={IMPULSE_KEY: "10"})
    hard_push = jobs("push", pushes, overrides={IMPULSE_KEY: "15"})
    climb, descent = jobs("slope-up-15", others), jobs("slope-down-20", others)
    return [
        *table,
        Claim("mean speed, deviation from commanded", walks + circle, speed_deviation, 0.03, 0.01),
        Claim("s-curve: completed", curve, completed, len(curve), len(curve), at_least=True),
        Claim("s-curve: mean tracking error m", curve, mean_of_completed, 0.10, 0.05),
        Claim("climb of 15 degrees: completed", climb, completed, len(climb), len(climb), at_least=True),
        Claim("descent of 20 degrees: completed", descent, completed, len(descent), len(descent), at_least=True),
        Claim("push of 10 N.s: withstood", push, pushes_withstood, len(push), len(push), at_least=True),
        Claim("push of 15 N.s: withstood", hard_push, pushes_withstood, None, len(hard_push), at_least=True),
        Claim(f"trot at {FASTEST_TROTS_MPS[0]} m/s: deviation", slower, speed_deviation, 0.05, None),
        Claim(f"trot at {FASTEST_TROTS_MPS[1]} m/s: deviation", faster, speed_deviation, None, 0.05),
        Claim("one seed, two PYTHONHASHSEEDs: differences", (), recorded_difference, 0.0, 0.0),
        Claim("replay: tasks that differ", (), replayed_difference, 0.0, 0.0),
        Claim("MPC p99 ms", circle, worst("mpc_ms", "p99"), 3.0, 1.5, decides=False),
        Claim("WBC tick median ms", circle, worst("wbc_ms", "median"), 0.8, 0.4, decides=False),
        Claim("WBC tick p99 ms", circle, worst("wbc_ms", "p99"), 1.6, 0.8, decides=False),
        Claim("real-time factor", circle, least("realtime_factor"), 1.5, 2.5, at_least=True, decides=False),
    ]


def vehicle_claims(full: bool) -> list[Claim]:
    """The same of the vehicle."""
    seeds = range(20 if full else 1)

    def jobs(scenario: str, **options: Any) -> tuple[Job, ...]:
        return tuple(Job(scenario, seed, robot="4ws4wd", **options) for seed in seeds)

    every = tuple(job for scenario in DRIVES for job in jobs(scenario))
    late = jobs("figure-eight", overrides={SPEED_KEY: "1.5", **LATE})
    fast = tuple(job for scenario in ("figure-eight", "slalom") for job in jobs(scenario, overrides={SPEED_KEY: "3"}))
    patch = jobs("slippery-bend", overrides={SPEED_KEY: "3"})
    bold, sliding = (jobs(scenario, overrides=BOLD) for scenario in ("figure-eight", "slippery-bend"))
    rms, furthest = worst("lateral_error_m", "rms"), worst("lateral_error_m", "max")
    return [
        Claim("4ws4wd: completed", every, completed, len(every), len(every), at_least=True),
        Claim("4ws4wd, 1.5 m/s, commands 0.3 s late: lateral RMS m", late, rms, 0.05, 0.025),
        Claim("4ws4wd, 3 m/s asked for: lateral max m", fast, furthest, 0.3, 0.15),
        Claim("4ws4wd, the same over a slippery bend: lateral max m", patch, furthest, 0.3, 0.15),
        Claim("4ws4wd, 3 m/s at v^2 kappa up to 0.5 mu g: lateral max m", bold, furthest, 0.3, 0.15),
        Claim("4ws4wd, the same over a slippery bend: lateral max m", sliding, furthest, 0.3, 0.15),
        Claim("4ws4wd, there: slows down to, of its speed", sliding, slowed_to, 0.8, None),
        Claim("4ws4wd, there: largest heading error rad", sliding, worst("heading_error_rad", "max"), SPUN_RAD, None),
        Claim("4ws4wd, paper 002 on kinematic plants: claims missed", (), paper_002_missed, 0.0, 0.0),
        Claim("4ws4wd: tracker step p99 ms", (), tracker_step_p99_ms, 1.0, 0.2, decides=False),
        Claim("4ws4wd: tick p99 ms", jobs("slalom"), worst("drive_ms", "p99"), None, None, decides=False),
    ]


def run(table: Sequence[Claim]) -> int:
    """Run every job once, print the table, and return the exit code."""
    names = {_identity(job): job for claim in table for job in claim.jobs}
    summaries: dict[str, Summary] = {}
    if names:
        with progress_bar("claims") as progress:
            summaries = dict(zip(names, run_jobs(list(names.values()), progress), strict=True))
    rows, missed = [], 0
    for claim in table:
        figure = claim.measure([summaries[_identity(job)] for job in claim.jobs])
        kept = claim.kept(figure)
        missed += claim.decides and not kept
        sign = ">=" if claim.at_least else "<="
        bound = None if claim.bound is None else f"{sign} {claim.bound:g}"
        verdict = ("kept" if kept else "MISSED") if claim.decides else ("kept" if kept else "not on this machine")
        verdict = verdict if claim.bound is not None else "reported"
        rows.append((claim.name, len(claim.jobs) or None, figure, bound, claim.aim, verdict))
    print_table("Claims", ("claim", "runs", "measured", "bound", "aim", ""), rows)
    return 1 if missed else 0


def _identity(job: Job) -> str:
    return repr(job)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the claims that were asked for."""
    parser = argparse.ArgumentParser(prog="claims", description="Compares what is measured with what is claimed.")
    parser.add_argument("--full", action="store_true", help="all the seeds that the claims are made for")
    parser.add_argument("--only", default="", metavar="TEXT", help="the claims whose name contains this")
    options = parser.parse_args(arguments)
    table = [claim for claim in (*claims(options.full), *vehicle_claims(options.full)) if options.only in claim.name]
    if not table:
        print(f"claims: none contains {options.only!r}", file=sys.stderr)
        return 2
    single_threaded()
    try:
        return run(table)
    except UgvError as error:
        print(f"claims: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
