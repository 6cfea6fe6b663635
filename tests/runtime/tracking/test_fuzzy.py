# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.fuzzy import SETS, TABLE_K_V, TABLE_K_W, coefficient_changes, infer

UNIVERSE = np.arange(-3.0, 4.0)

# Typed from the paper a second time, column by column (ec from NB to PB, each column e from NB to PB).
K_V_COLUMNS = (
    "PB PB PM PM PS PS ZO",
    "PB PB PM PM PS ZO ZO",
    "PB PB PM PS ZO NS NM",
    "PB PB PM ZO NS NM NM",
    "PM PM ZO NS NM NM NM",
    "PS ZO PS NS NM NM NB",
    "ZO ZO NS NM NM NB NB",
)
K_W_COLUMNS = (
    "PS NS NB NB NB NM NS",
    "PS NS NB NM NM NS ZO",
    "ZO NS NM NM NS NS ZO",
    "ZO NS NM NS NS NS ZO",
    "ZO ZO NS NS ZO ZO ZO",
    "PB NS PS NS PS PS PB",
    "PB PM PM PM PS PS PB",
)


def triangles(value: float) -> np.ndarray:
    return np.clip(1.0 - np.abs(value - UNIVERSE), 0.0, None)


def rules(columns: tuple[str, ...]) -> np.ndarray:
    return np.array([[SETS.index(name) for name in column.split()] for column in columns]).T


def dense(e: float, ec: float, table: np.ndarray) -> float:
    """All 49 rules, clipped output triangles, their maximum, and eq 21 over the seven points."""
    weights = np.minimum.outer(triangles(np.clip(e, -3, 3)), triangles(np.clip(ec, -3, 3)))
    outputs = np.array([triangles(point) for point in UNIVERSE]).T  # set x point
    clipped = np.minimum(weights[:, :, None], outputs[table])
    u = clipped.max(axis=(0, 1))
    return float((u * UNIVERSE).sum() / u.sum())


def test_equal_to_a_dense_seven_point_mamdani_on_a_fine_grid():
    k_v, k_w = rules(K_V_COLUMNS), rules(K_W_COLUMNS)
    worst = 0.0
    for e in np.linspace(-3.5, 3.5, 71):
        for ec in np.linspace(-3.3, 3.3, 67):
            a, b = infer(float(e), float(ec))
            worst = max(worst, abs(a - dense(e, ec, k_v)), abs(b - dense(e, ec, k_w)))
    assert worst < 1e-12


def test_at_set_centres_the_printed_rule_is_the_answer():
    k_v = [row.split() for row in TABLE_K_V.strip().splitlines()]
    k_w = [row.split() for row in TABLE_K_W.strip().splitlines()]
    for i in range(7):
        for j in range(7):
            expected = SETS.index(k_v[i][j]) - 3, SETS.index(k_w[i][j]) - 3
            assert infer(i - 3.0, j - 3.0) == expected


def test_the_oddity_of_table_1_is_kept():
    assert infer(-1.0, 2.0)[0] == 1.0
    assert infer(-1.0, 1.0)[0] == 0.0


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_left_and_right_are_treated_alike(error, rate):
    assert coefficient_changes(error, rate) == coefficient_changes(-error, rate)


@given(st.floats(-3.5, 3.5), st.floats(-3.5, 3.5), st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6))
def test_continuous(e, ec, de, dec):
    before, after = infer(e, ec), infer(e + de, ec + dec)
    assert before == pytest.approx(after, abs=1e-4)


@given(st.floats(allow_nan=False), st.floats(allow_nan=False))
def test_bounded_and_saturating_over_every_input(e, ec):
    result = infer(e, ec)
    assert all(-3.0 <= value <= 3.0 for value in result)
    assert result == infer(min(max(e, -3.0), 3.0), min(max(ec, -3.0), 3.0))


def test_saturates_at_30_centimetres_and_30_centimetres_a_second():
    assert coefficient_changes(0.31, 0.4) == coefficient_changes(5.0, math.inf) == infer(3.0, 3.0)
    assert coefficient_changes(0.1, 0.0) == pytest.approx(infer(1.0, 0.0))


@pytest.mark.parametrize("inputs", [(math.nan, 0.0), (0.0, math.nan)])
def test_nan_is_refused(inputs):
    with pytest.raises(ValueError, match="must not be NaN"):
        infer(*inputs)
