# SPDX-License-Identifier: Apache-2.0
"""What the loops are claimed to keep in real time, and whether they did."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from runtime.cli.rt_figures import Figures, Shares

RATIO_MAX = 1.5
"""Of the 99th percentile of waking to that of cyclictest."""


class Claim(NamedTuple):
    """One claim.

    Attributes:
        says: what is claimed, and of which rate and load.
        measured: what was found.
        kept: whether it is kept; None if that could not be measured.
    """

    says: str
    measured: str
    kept: bool | None


def claims(condition: str, ours: Figures | None, bare: Figures | None, reference: Shares | None) -> list[Claim]:
    """Judge one rate and load.

    Args:
        condition: the rate and load, for people.
        ours: of the loop with its tasks; None if no tick ran.
        bare: of the loop without tasks; the same.
        reference: what cyclictest saw of waking, us; None without it.
    """
    own = f"{condition}: no overrun by our own compute"
    late = f"{condition}: late wakes overrun no more periods than of the bare loop"
    ratio = f"{condition}: p99 of waking at most {RATIO_MAX:g} times that of cyclictest"
    if ours is None:
        return [Claim(says, "nothing ran", None) for says in (own, late, ratio)]
    return [
        Claim(own, f"{ours.own} of {ours.ticks} ticks", ours.own == 0),
        _late(late, ours, bare),
        _ratio(ratio, ours, reference),
    ]


def _late(says: str, ours: Figures, bare: Figures | None) -> Claim:
    if bare is None:
        return Claim(says, f"{ours.late_percent:.3g} %, no bare loop", None)
    measured = f"{ours.late_percent:.2g} % to {bare.late_percent:.2g} %; in all {ours.late} to {bare.late}"
    return Claim(says, measured, ours.late_percent <= bare.late_percent)


def _ratio(says: str, ours: Figures, reference: Shares | None) -> Claim:
    if reference is None:
        return Claim(says, f"{ours.wake_us[1]:.3g} us, no cyclictest", None)
    ratio = ours.wake_us[1] / reference[1]
    return Claim(says, f"{ratio:.3g} ({ours.wake_us[1]:.3g} to {reference[1]:.3g} us)", ratio <= RATIO_MAX)


def print_claims(found: Sequence[Claim]) -> None:
    """Print the verdicts."""
    from runtime.cli.console import print_table

    words = {True: "yes", False: "NO", None: "not shown"}
    print_table("Claims", ("claim", "measured", "kept"), [(one.says, one.measured, words[one.kept]) for one in found])
