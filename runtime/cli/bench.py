# SPDX-License-Identifier: Apache-2.0
"""`ugv bench`: figures with percentiles, each beside what it is compared with. Nothing here passes or fails."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any

ROBOT, SCENARIO = "uslgo1", "circle-6cm"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("part", choices=tuple(PARTS), help="what to measure")


def run(options: argparse.Namespace) -> int:
    """Measure and print."""
    PARTS[options.part]()
    return 0


def percentiles(samples: Sequence[float]) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum."""
    import numpy as np

    median, high = np.percentile(samples, (50.0, 99.0))
    return float(median), float(high), float(np.max(samples))


def _fuzzy() -> None:
    """Time of one inference, and its largest difference from all 49 rules evaluated densely."""
    from time import perf_counter_ns

    import numpy as np

    from runtime.cli.console import print_table
    from runtime.tracking.fuzzy import infer

    inputs = [(float(e), float(ec)) for e, ec in np.random.default_rng(0).uniform(-3.2, 3.2, (20_000, 2))]
    sparse_us = []
    for e, ec in inputs:
        start = perf_counter_ns()
        infer(e, ec)
        sparse_us.append((perf_counter_ns() - start) / 1e3)
    dense_us, difference = [], 0.0
    for e, ec in inputs[:2000]:
        start = perf_counter_ns()
        expected = dense_inference(e, ec)
        dense_us.append((perf_counter_ns() - start) / 1e3)
        difference = max(difference, *(abs(a - b) for a, b in zip(infer(e, ec), expected, strict=True)))
    print_table(
        "Fuzzy inference, us (claimed: 15, aim 5)",
        ("", "median", "p99", "max"),
        [("four rules", *percentiles(sparse_us)), ("all rules", *percentiles(dense_us))],
    )
    print(f"largest difference between the two: {difference:.2g}")


def dense_inference(e: float, ec: float) -> tuple[float, float]:
    """Max-min over all 49 rules and the seven-point sum, as eq 19-21 are printed; the yardstick of the fast form."""
    import numpy as np

    from runtime.tracking.fuzzy import TABLE_K_V, TABLE_K_W, parse_table

    centers = np.arange(-3.0, 4.0)

    def membership(value: float) -> Any:
        return np.maximum(0.0, 1.0 - np.abs(np.clip(value, -3.0, 3.0) - centers))

    firing = np.minimum.outer(membership(e), membership(ec))
    outputs = []
    for text in (TABLE_K_V, TABLE_K_W):
        conclusions = np.array(parse_table(text))
        weights = np.array([np.max(firing[conclusions == point], initial=0.0) for point in range(7)])
        outputs.append(float(weights @ centers / weights.sum()))
    return outputs[0], outputs[1]


def _loop_times(key: str, claimed: str) -> None:
    from runtime.cli.console import print_table

    times = _circle()[key]
    print_table(
        f"{key.removesuffix('_ms').upper()} on {SCENARIO}, ms (claimed: {claimed})",
        ("", "median", "p99", "max"),
        [(ROBOT, times["median"], times["p99"], times["max"])],
    )


def _mpc() -> None:
    _loop_times("mpc_ms", "p99 3, aim 1.5")


def _wbc() -> None:
    _loop_times("wbc_ms", "median 0.8 and p99 1.6, aim 0.4 and 0.8")


def _sil() -> None:
    from runtime.cli.console import print_table

    summary = _circle()
    print_table(
        f"Lockstep on {SCENARIO} (claimed: 1.5 times real time, aim 2.5)",
        ("", "simulated s", "wall s", "real-time factor"),
        [(ROBOT, summary["sim_time_s"], summary["wall_time_s"], summary["realtime_factor"])],
    )


def _circle() -> dict[str, Any]:
    """One run of the scenario that figures are taken on, not written."""
    from runtime.cli.console import progress_bar
    from runtime.cli.sil import simulate

    with progress_bar(f"{ROBOT} {SCENARIO}") as progress:
        return simulate(
            ROBOT,
            SCENARIO,
            seed=0,
            estimator="kalman",
            controller="FpMW",
            overrides={},
            out=None,
            progress=progress,
        )


PARTS: dict[str, Callable[[], None]] = {"mpc": _mpc, "wbc": _wbc, "fuzzy": _fuzzy, "sil": _sil}
