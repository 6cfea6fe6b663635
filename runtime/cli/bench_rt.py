# SPDX-License-Identifier: Apache-2.0
"""`ugv bench rt`: how late the loops wake, how long they take, and how often and why they overrun, on the wall clock.

The real tasks are given the inputs of a recorded walk, MPC beside WBC, each a thread of the real-time executor.
Between such slices come slices of the same loops without tasks, of those with tasks woken at their release and no
earlier (as cyclictest is), and of cyclictest where it is installed: all see the same machine in the same minutes, and
their ratios say what is ours. It is measured idle and, where stress-ng is installed, under its load; a table at the end
says which claims were kept.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from runtime.cli.overruns import Slice, typical_busy_ns
from runtime.cli.rt_claims import Claim, claims, print_claims
from runtime.cli.rt_figures import QUANTILES, Figures, Shares, figures_of, medians
from runtime.cli.rt_slices import STANDING_UP_S, Walk, cyclictest, load
from runtime.executors.realtime import WAKE_EARLY_US

RATES_HZ = (500, 1000)
SLICE_S, LIVE_S = 5.0, 20.0
WITH_TASKS, WITHOUT_TASKS = "with tasks", "without tasks"
VARIANTS = {
    WITH_TASKS: (False, WAKE_EARLY_US),
    WITHOUT_TASKS: (True, WAKE_EARLY_US),
    "woken at release": (False, 0),
}
"""Slices of our loops: whether they are bare, and how early the fast one is woken."""
LEGEND = """\
with tasks: the fast loop on a recorded walk, the slow one beside it; without tasks: the same loops, empty
both are woken early and wait for their release awake; woken at release: with tasks, but no earlier, as cyclictest is
ratio: p99 of waking to cyclictest's; compute: of the tasks; busy: from waking to the end of a tick
dearest: the longest of the ticks' medians; late wakes, interrupted: % of the periods that overran by them, or
without tasks: would have, with what the same ticks need; own: overruns of ticks that need more than is left of
their period, of which a wake may use half"""


def run(slices: int) -> int:
    """Measure in so many slices of each kind, then a run in real time; 1 if a claim was not kept."""
    found = measure(slices)
    measure_live()
    print_claims(found)
    return 1 if any(claim.kept is False for claim in found) else 0


def measure(slices: int, seconds: float = SLICE_S) -> list[Claim]:
    """Measure at each rate, idle and loaded, and print; gives what is claimed of it."""
    from runtime.cli.bench import SCENARIO, recorded
    from runtime.cli.console import progress_bar

    refusals: list[str] = []
    withheld: list[str] = []
    judged: list[Claim] = []
    loads = [False, True] if shutil.which("stress-ng") else [False]
    for rate_hz in RATES_HZ:
        with recorded(SCENARIO, STANDING_UP_S + seconds + 0.5, {"loops.wbc_hz": str(rate_hz)}) as run_directory:
            walk = Walk(run_directory, seconds, withheld.append)
            for loaded in loads:
                found: dict[str, list[Slice]] = {name: [] for name in VARIANTS}
                reference: list[list[float]] = []
                condition = f"{rate_hz} Hz, {'every processor loaded' if loaded else 'idle'}"
                with progress_bar(condition) as progress, load(loaded):
                    for number in range(slices):
                        for name, (bare, wake_early_us) in VARIANTS.items():
                            found[name].append(walk.slice(bare, wake_early_us))
                        reference.append(cyclictest(walk.period_ns, seconds, 80, refusals.append))
                        progress(number + 1, slices)
                needs_ns = typical_busy_ns(found[WITH_TASKS])
                figures = {name: figures_of(taken, walk.period_ns, needs_ns) for name, taken in found.items()}
                base = medians(reference)
                _print(condition, figures, base, slices)
                judged += claims(condition, figures[WITH_TASKS], figures[WITHOUT_TASKS], base)
    print(LEGEND)
    for refusal in dict.fromkeys(withheld):
        print(f"the loops: {refusal}")
    for refusal in dict.fromkeys(refusals):
        print(f"{refusal}; so {refusals.count(refusal)} slices have no reference")
    for tool in ("cyclictest", "stress-ng"):
        if shutil.which(tool) is None:
            print(f"{tool} is not installed, so what it would show is missing (Debian: rt-tests, stress-ng)")
    return judged


def measure_live(seconds: float = LIVE_S) -> None:
    """A walk in real time, every process of the robot running, and print how late each woke and how old the IMU was."""
    from runtime.cli.bench import ROBOT, SCENARIO
    from runtime.cli.console import print_table, progress_bar
    from runtime.cli.sil import simulate_live
    from runtime.executors.tick import TICK_TOPIC_PREFIX
    from runtime.recording.log import Log
    from runtime.recording.loop_timing import imu_age

    with tempfile.TemporaryDirectory(prefix="ugv-bench-") as parent:
        out = Path(parent) / "live"
        out.mkdir()
        with progress_bar(f"{SCENARIO} in real time") as progress:
            summary = simulate_live(ROBOT, SCENARIO, out=out, until_s=seconds, progress=progress)
        log = Log(out)
        rows = []
        for loop in ("wbc", "mpc", "link", "sim"):
            ticks = log.read_signal(TICK_TOPIC_PREFIX + loop).values
            wake = np.percentile(ticks["wake_latency_ns"] * 1e-3, QUANTILES)
            compute = np.percentile(ticks["compute_ns"] * 1e-3, QUANTILES[:2])
            rows.append((loop, *wake, *compute, 100.0 * ticks["skipped"].sum() / (ticks["index"][-1] + 1)))
    age = imu_age(log)
    shares = (None,) * len(QUANTILES) if age is None else tuple(share * 1e-3 for share in age[: len(QUANTILES)])
    print_table(
        f"{SCENARIO} in real time, {summary['sim_time_s']:.0f} s, us",
        ("", "wake p50", "p99", "p99.9", "compute p50", "p99", "skipped %"),
        rows,
    )
    print_table(
        "age of the inertial sample that the estimator used, us", ("", "p50", "p99", "p99.9"), [("IMU", *shares)]
    )


def _print(title: str, found: Mapping[str, Figures | None], base: Shares | None, slices: int) -> None:
    from runtime.cli.console import print_table

    title = f"{title}: medians over {slices} slices, us"
    wakes: list[tuple[Any, ...]] = [(name, *_wake(one, base)) for name, one in found.items()]
    if base is not None:
        wakes.append(("cyclictest", *base, 1.0))
    print_table(title, ("", "wake p50", "p99", "p99.9", "ratio"), wakes)
    print_table(
        title,
        ("", "compute p50", "p99", "p99.9", "busy p50", "p99", "dearest", "late wakes", "interrupted", "own"),
        [(name, *_work(one)) for name, one in found.items()],
    )


def _wake(one: Figures | None, base: Shares | None) -> tuple[Any, ...]:
    """Wake latency, and its ratio to the reference."""
    return (None,) * 4 if one is None else (*one.wake_us, base and one.wake_us[1] / base[1])


def _work(one: Figures | None) -> tuple[Any, ...]:
    """What ticks take, and overruns by cause."""
    if one is None:
        return (None,) * 9
    return (*one.compute_us, *one.busy_us[:2], one.dearest_us, one.late_percent, one.interrupted_percent, one.own)
