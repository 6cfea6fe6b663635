# SPDX-License-Identifier: Apache-2.0
"""What paper 002 prints."""

from __future__ import annotations

from typing import NamedTuple


class Printed(NamedTuple):
    """A row of Table II.

    Attributes:
        mean_m: average error.
        settled_s: steady time.
        inner_deg: maximum steering angle: that of the inner wheels at the start.
    """

    mean_m: float
    settled_s: float
    inner_deg: float


TABLE_II = {
    "pure pursuit": Printed(0.234, 15.3, 56.9),
    "LDC, K_r 0.6": Printed(0.242, 14.8, 42.7),
    "LDC, K_r 0.9": Printed(0.209, 7.5, 30.2),
    "LDC, K_r 1.2": Printed(0.215, 8.0, 16.7),
}
"""By the name of the contender."""
CURVE_MEAN_M = {"pure pursuit": 0.121, "fuzzy + LDC (the paper's)": 0.085}
"""Mean error of the curve experiment, on a path that is not given; whether the start counts is not said."""
CURVE_RATIO = 0.085 / 0.121
INNER_RATIO = 30.2 / 56.9
"""Of the largest steering angles with K_r 0.9 and without the constraint."""
