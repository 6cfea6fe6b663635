# SPDX-License-Identifier: Apache-2.0
"""`ugv bench rt`: how late the loops wake, how long they take, and how often and why they overrun, on the wall clock.

The real tasks are given the inputs of a recorded walk, MPC beside WBC, each a thread of the real-time executor.
Between such slices come slices of the same loops without tasks, of those with tasks woken at their release and no
earlier (as cyclictest is), and of cyclictest where it is installed: all see the same machine in the same minutes, and
their ratios say what is ours. It is measured idle and, where stress-ng is installed, under its load.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.cli.overruns import Slice, causes, typical_busy_ns
from runtime.cli.rt_slices import STANDING_UP_S, Walk, cyclictest, load
from runtime.executors.realtime import WAKE_EARLY_US

RATES_HZ = (500, 1000)
SLICES, SLICE_S, LIVE_S = 12, 5.0, 20.0
QUANTILES = (50.0, 99.0, 99.9)
VARIANTS = {
    "with tasks": (False, WAKE_EARLY_US),
    "without tasks": (True, WAKE_EARLY_US),
    "woken at release": (False, 0),
}
"""Slices of our loops: whether they are bare, and how early the fast one is woken."""
LEGEND = """\
with tasks: the fast loop on a recorded walk, the slow one beside it; without tasks: the same loops, empty
both are woken early and wait for their release awake; woken at release: with tasks, but no earlier, as cyclictest is
ratio: p99 of waking to cyclictest's; busy: from waking to the end of a tick; dearest: the longest of the ticks' medians
late wakes, interrupted: % of the periods that overran by them; own: overruns of ticks that take a period as a rule"""


def measure(slices: int = SLICES, seconds: float = SLICE_S) -> None:
    """Measure at each rate, idle and loaded, and print."""
    from runtime.cli.bench import SCENARIO, recorded
    from runtime.cli.console import progress_bar

    refusals: list[str] = []
    withheld: list[str] = []
    loads = [False, True] if shutil.which("stress-ng") else [False]
    for rate_hz in RATES_HZ:
        with recorded(SCENARIO, STANDING_UP_S + seconds + 0.5, {"loops.wbc_hz": str(rate_hz)}) as run_directory:
            walk = Walk(run_directory, seconds, withheld.append)
            for loaded in loads:
                found: dict[str, list[Slice]] = {name: [] for name in VARIANTS}
                reference: list[list[float]] = []
                with progress_bar(f"{rate_hz} Hz, {'loaded' if loaded else 'idle'}") as progress, load(loaded):
                    for number in range(slices):
                        for name, (bare, wake_early_us) in VARIANTS.items():
                            found[name].append(walk.slice(bare, wake_early_us))
                        reference.append(cyclictest(walk.period_ns, seconds, 80, refusals.append))
                        progress(number + 1, slices)
                _print(rate_hz, loaded, found, reference)
    print(LEGEND)
    for refusal in dict.fromkeys(withheld):
        print(f"the loops: {refusal}")
    for refusal in dict.fromkeys(refusals):
        print(f"{refusal}; so {refusals.count(refusal)} slices have no reference")
    for tool in ("cyclictest", "stress-ng"):
        if shutil.which(tool) is None:
            print(f"{tool} is not installed, so what it would show is missing (Debian: rt-tests, stress-ng)")


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


def _print(
    rate_hz: int, loaded: bool, found: Mapping[str, Sequence[Slice]], reference: Sequence[Sequence[float]]
) -> None:
    from runtime.cli.console import print_table

    base = medians(reference)
    rows = [(name, *_row(slices, rate_hz, base)) for name, slices in found.items()]
    if base is not None:
        rows.append(("cyclictest", *base, 1.0, *(None,) * 6))
    print_table(
        f"{rate_hz} Hz, {'every processor loaded' if loaded else 'idle'}: medians over {len(reference)} slices, us",
        ("", "wake p50", "p99", "p99.9", "ratio", "busy p50", "p99", "dearest", "late wakes", "interrupted", "own"),
        rows,
    )


def medians(samples: Sequence[Sequence[float] | npt.NDArray[np.float64]]) -> tuple[float, float, float] | None:
    """Medians over slices of the 50th, 99th and 99.9th percentile; slices in which nothing ran are left out."""
    samples = [one for one in samples if len(one)]
    if not samples:
        return None
    p50, p99, p999 = np.median([np.percentile(one, QUANTILES) for one in samples], axis=0)
    return float(p50), float(p99), float(p999)


def _row(slices: Sequence[Slice], rate_hz: int, base: tuple[float, float, float] | None) -> tuple[Any, ...]:
    """Wake latency, its ratio to the reference, what ticks take, and overruns by cause."""
    period_ns = 10**9 // rate_hz
    wake = medians([one.wake_ns / 1e3 for one in slices])
    busy = medians([one.busy_ns / 1e3 for one in slices])
    if wake is None or busy is None:
        return (None,) * 10
    numbers, typical_ns = typical_busy_ns(slices)
    found = [causes(one, period_ns, numbers[typical_ns >= period_ns]) for one in slices]
    late, interrupted = (
        float(np.median([100.0 * getattr(one, cause) / one.periods for one in found if one.periods]))
        for cause in ("late_wake", "interrupted")
    )
    own = sum(one.own for one in found)
    dearest = typical_ns.max(initial=0.0) / 1e3
    return (*wake, base and wake[1] / base[1], *busy[:2], dearest, late, interrupted, own)
