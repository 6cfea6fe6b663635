# SPDX-License-Identifier: Apache-2.0
"""Mamdani inference of the two look-ahead coefficients (paper 000, section 3.2, eq 19-21, Tables 1 and 2, corrected).

Inputs and outputs live on [-3, 3] with seven uniform triangular sets NB..PB centred on the integers. Rules combine by
max-min; the result is the seven-point sum over {-3..3} (eq 21). At an integer only the triangle centred there is not
zero, so the aggregate at a point is the largest weight among the rules that conclude on that set, and at most four
rules fire.
"""

from __future__ import annotations

ERROR_AT_LIMIT_M = 0.3
ERROR_RATE_AT_LIMIT_MPS = 0.3
"""Error and rate at which the inputs saturate (not in print)."""

SETS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")

# Rows are e from NB to PB, columns ec from NB to PB, both as printed.
TABLE_K_V = """
    PB PB PB PB PM PS ZO
    PB PB PB PB PM ZO ZO
    PM PM PM PM ZO PS NS
    PM PM PS ZO NS NS NM
    PS PS ZO NS NM NM NM
    PS ZO NS NM NM NM NB
    ZO ZO NM NM NM NB NB
"""
TABLE_K_W = """
    PS PS ZO ZO ZO PB PB
    NS NS NS NS ZO NS PM
    NB NB NM NM NS PS PM
    NB NM NM NS NS NS PM
    NB NM NS NS ZO PS PS
    NM NS NS NS ZO PS PS
    NS ZO ZO ZO ZO PB PB
"""


def parse_table(text: str) -> tuple[tuple[int, ...], ...]:
    """A printed rule table as indices of sets, 0 for NB to 6 for PB."""
    return tuple(tuple(SETS.index(name) for name in row.split()) for row in text.strip().splitlines())


def _cells() -> tuple[tuple[int, ...], ...]:
    """For each of the 6 x 6 cells between set centres, the four conclusions of either table: low-low, low-high, ..."""
    tables = parse_table(TABLE_K_V), parse_table(TABLE_K_W)
    return tuple(
        tuple(table[row + i][column + j] for table in tables for i in (0, 1) for j in (0, 1))
        for row in range(6)
        for column in range(6)
    )


_CELLS = _cells()


def infer(e: float, ec: float) -> tuple[float, float]:
    """Both tables at once.

    Args:
        e: error on the universe [-3, 3]; saturates.
        ec: change of error on the universe [-3, 3]; saturates.

    Returns:
        Delta k_v and Delta k_w, each in [-3, 3].

    Raises:
        ValueError: if an input is NaN.
    """
    x, y = e + 3.0, ec + 3.0
    if x != x or y != y:
        raise ValueError(f"fuzzy inference: e = {e}, ec = {ec} must not be NaN")
    x = 0.0 if x < 0.0 else 6.0 if x > 6.0 else x
    y = 0.0 if y < 0.0 else 6.0 if y > 6.0 else y
    i = 5 if x >= 5.0 else int(x)
    j = 5 if y >= 5.0 else int(y)
    x_high, y_high = x - i, y - j
    x_low, y_low = 1.0 - x_high, 1.0 - y_high
    low_low = x_low if x_low < y_low else y_low
    low_high = x_low if x_low < y_high else y_high
    high_low = x_high if x_high < y_low else y_low
    high_high = x_high if x_high < y_high else y_high
    a, b, c, d, p, q, r, s = _CELLS[6 * i + j]
    u = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    u[a] = low_low
    if low_high > u[b]:
        u[b] = low_high
    if high_low > u[c]:
        u[c] = high_low
    if high_high > u[d]:
        u[d] = high_high
    w = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    w[p] = low_low
    if low_high > w[q]:
        w[q] = low_high
    if high_low > w[r]:
        w[r] = high_low
    if high_high > w[s]:
        w[s] = high_high
    return (
        (3.0 * (u[6] - u[0]) + 2.0 * (u[5] - u[1]) + u[4] - u[2]) / sum(u),
        (3.0 * (w[6] - w[0]) + 2.0 * (w[5] - w[1]) + w[4] - w[2]) / sum(w),
    )


def coefficient_changes(lateral_error: float, error_rate: float) -> tuple[float, float]:
    """Delta k_v and Delta k_w for a lateral error.

    The tables are not antisymmetric, so the magnitude of the error is what they see: left and right are treated alike.

    Args:
        lateral_error: m; its sign does not matter.
        error_rate: rate of change of the error's magnitude, m/s.

    Raises:
        ValueError: if an input is NaN.
    """
    return infer(abs(lateral_error) * (3.0 / ERROR_AT_LIMIT_M), error_rate * (3.0 / ERROR_RATE_AT_LIMIT_MPS))
