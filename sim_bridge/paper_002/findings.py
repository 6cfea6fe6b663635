# SPDX-License-Identifier: Apache-2.0
"""Where the paper's claims hold and where they do not, said of the figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from sim_bridge.paper_002.contenders import COMPENSATED, CONTENDERS, FUZZY, GAINS, OURS, PAPERS, PLAIN, Contender
from sim_bridge.paper_002.plants import DELAYS_NS, PLANTS, PROMPT, WORST, late_command
from sim_bridge.paper_002.printed import CURVE_MEAN_M, INNER_RATIO, TABLE_II
from sim_bridge.paper_002.results import SHAPES, Results

_, _, CONSTRAINED, LONGEST = GAINS
ALIKE = 1.2
"""Figures whose ratio is less than this are said to be about the same."""


def findings(results: Results) -> list[str]:
    """Sentences."""
    makers: Sequence[Callable[[Results], str]] = (
        _error_on_the_straight,
        _settling,
        _steering_angle,
        _error_on_curves,
        _what_the_constraint_does_on_curves,
        _plain_pursuit_and_delay,
        _compensation,
        _best,
    )
    return [make(results) for make in makers]


def _error_on_the_straight(results: Results) -> str:
    def change(plant: str) -> tuple[float, float]:
        before, after = (results.straight(plant, who).settling.mean_25_s_m for who in (PLAIN, CONSTRAINED))
        return before, after

    before, after = (TABLE_II[who.name].mean_m for who in (PLAIN, CONSTRAINED))
    printed = f"Straight: in the paper K_r 0.9 lowers the mean error from {before:.3f} to {after:.3f} m. "
    return printed + _divided(change, "{:.3f} to {:.3f} m")


def _settling(results: Results) -> str:
    def change(plant: str) -> tuple[float, float]:
        before, after = (results.straight(plant, who).settling.time_s for who in (PLAIN, CONSTRAINED))
        return before, after

    before, after = (TABLE_II[who.name].settled_s for who in (PLAIN, CONSTRAINED))
    printed = f"Straight: in the paper K_r 0.9 shortens settling from {before:.1f} to {after:.1f} s. "
    return printed + _divided(change, "{:.1f} to {:.1f} s")


def _steering_angle(results: Results) -> str:
    ratios = [results.inner_ratio(plant, CONSTRAINED) for plant in PLANTS]
    angle = math.degrees(results.straight(PROMPT, LONGEST).inner_rad)
    return (
        f"Straight: with K_r 0.9 the largest inner steering angle is {_span(ratios)} of plain pursuit's on these "
        f"plants, in the paper {INNER_RATIO:.2f}. With K_r 1.2 it is {angle:.1f} degrees, in the paper "
        f"{TABLE_II[LONGEST.name].inner_deg}."
    )


def _error_on_curves(results: Results) -> str:
    def change(plant: str) -> tuple[float, float]:
        return results.after_m(plant, PLAIN), results.after_m(plant, PAPERS)

    before, after = CURVE_MEAN_M[PLAIN.name], CURVE_MEAN_M[PAPERS.name]
    lost = [
        f"{len(SHAPES) - results.arrived(plant, PAPERS)} of {len(SHAPES)} for {plant}"
        for plant in PLANTS
        if results.arrived(plant, PAPERS) < len(SHAPES)
    ]
    printed = f"Curves, after the first 12 s: in the paper fuzzy + LDC lowers the error from {before} to {after} m. "
    missed = f" It misses the goal on {_joined(lost)}." if lost else ""
    return printed + _divided(change, "{:.3f} to {:.3f} m") + missed


def _what_the_constraint_does_on_curves(results: Results) -> str:
    shares = {plant: results.after_m(plant, PAPERS) / results.after_m(plant, FUZZY) for plant in PLANTS}
    alike = [plant for plant, share in shares.items() if 1.0 / ALIKE < share < ALIKE]
    others = [f"{share:.2f} times that for {plant}" for plant, share in shares.items() if plant not in alike]
    said = "Curves: the error of fuzzy + LDC is that of fuzzy alone"
    if not alike:
        return f"{said} {_joined(others)}."
    return f"{said}, about, for {_joined(alike)}" + (f", and {_joined(others)}." if others else ".")


def _plain_pursuit_and_delay(results: Results) -> str:
    errors = [results.after_m(late_command(delay), PLAIN) for delay in (0, *DELAYS_NS)]
    listed = _joined([f"{error:.3f}" for error in errors])
    told = f"Curves: plain pursuit's error is {listed} m for commands 0, 0.3 and 0.6 s late"
    falls = errors == sorted(errors, reverse=True)
    return told + ("; late commands take back some of the corners that it cuts." if falls else ".")


def _compensation(results: Results) -> str:
    straight = [results.straight(WORST, who).settling.mean_25_s_m for who in (PAPERS, COMPENSATED)]
    curves = [results.after_m(WORST, who) for who in (PAPERS, COMPENSATED)]
    return (
        f"Steering from the predicted pose, over a delay that is learnt on the way, takes fuzzy + LDC for {WORST} "
        f"from {curves[0]:.3f} to {curves[1]:.3f} m on curves, and from {straight[0]:.3f} to {straight[1]:.3f} m on "
        "the straight."
    )


def _best(results: Results) -> str:
    def leading(error: Callable[[Contender], float]) -> str:
        return ", ".join(f"{who.name} {error(who):.3f} m" for who in sorted(CONTENDERS, key=error)[:3])

    straight = leading(lambda who: results.straight(WORST, who).settling.mean_25_s_m)
    curves = leading(lambda who: results.after_m(WORST, who))
    angle = math.degrees(results.straight(WORST, OURS).inner_rad)
    return (
        f"The least errors for {WORST}: on the straight {straight}; on curves {curves}. With {OURS.name}, the largest "
        f"inner steering angle that is asked for on the straight is {angle:.0f} degrees."
    )


def _divided(change: Callable[[str], tuple[float, float]], form: str) -> str:
    """On which plants the second of two figures is less than the first, and on which it is not; NaN is not."""
    told = {plant: f"{plant} ({form.format(*change(plant))})" for plant in PLANTS}
    lower = [told[plant] for plant in PLANTS if change(plant)[1] < change(plant)[0]]
    others = [text for text in told.values() if text not in lower]
    if not others:
        return f"So it does on every plant: {_joined(lower)}."
    if not lower:
        return f"It does so on no plant: {_joined(others)}."
    return f"That holds for {_joined(lower)}; it does not for {_joined(others)}."


def _joined(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _span(values: Sequence[float]) -> str:
    """From the least to the greatest."""
    low, high = (f"{bound:.2f}" for bound in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
