# SPDX-License-Identifier: Apache-2.0
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.tracking.bends import Bend, arc, path_of_bends
from runtime.tracking.curvature import mean_curvature
from runtime.tracking.curvature_look_ahead import CurvatureLookAhead
from runtime.tracking.curvature_rules import inferred_distance, memberships
from runtime.tracking.paths import circle
from runtime.tracking.polyline import Polyline

DISTANCES = (0.6, 1.05, 1.5)
CENTRES = np.array([0.0, 0.2, 0.4])

# Table I as printed, row by row (* is its "none"), and the row that is not in print.
PRINTED = ("sss-l", "ssm-m", "ssl-m", "sm*-m", "l**-s", "ms*-m", "mm*-m", "ml*-s")
COMPLETED = (*PRINTED, "sl*-s")

# What that says of each combination.
EXPANDED = {
    **{("s", "s", far): "l" if far == "s" else "m" for far in "sml"},
    **{("s", "m", far): "m" for far in "sml"},
    **{("s", "l", far): "s" for far in "sml"},
    **{("m", "s", far): "m" for far in "sml"},
    **{("m", "m", far): "m" for far in "sml"},
    **{("m", "l", far): "s" for far in "sml"},
    **{("l", near, far): "s" for near in "sml" for far in "sml"},
}

curvatures = st.floats(-0.6, 0.6)


def dense_mamdani(*inputs: float) -> float:
    """All rules on sampled membership functions, max-min, weighted mean of the singletons."""
    clipped = [min(abs(value), 0.4) for value in inputs]
    truths = [np.maximum(1.0 - np.abs(value - CENTRES) / 0.2, 0.0) for value in clipped]
    strength = dict.fromkeys("sml", 0.0)
    for rule in COMPLETED:
        named = zip(truths, rule[:3], strict=True)
        weight = min(truth["sml".index(name)] for truth, name in named if name != "*")
        strength[rule[-1]] = max(strength[rule[-1]], weight)
    return float(np.average(DISTANCES, weights=[strength[name] for name in "sml"]))


@given(curvatures, curvatures, curvatures)
def test_equals_a_dense_mamdani_inference(here, near, far):
    assert inferred_distance(here, near, far, DISTANCES) == pytest.approx(dense_mamdani(here, near, far), abs=1e-12)


@given(curvatures, curvatures, curvatures)
def test_left_and_right_are_alike_and_the_distance_within_its_range(here, near, far):
    distance = inferred_distance(here, near, far, DISTANCES)
    assert 0.6 - 1e-12 <= distance <= 1.5 + 1e-12
    assert inferred_distance(-here, -near, -far, DISTANCES) == distance


def test_rules_at_the_centres_of_the_sets():
    for names, conclusion in EXPANDED.items():
        inputs = [float(CENTRES["sml".index(name)]) for name in names]
        assert inferred_distance(*inputs, DISTANCES) == pytest.approx(DISTANCES["sml".index(conclusion)])
    assert len(EXPANDED) == 27


@given(curvatures)
def test_memberships_are_a_partition(curvature):
    truths = memberships(curvature)
    assert sum(truths) == pytest.approx(1.0)
    assert min(truths) >= 0.0


def test_nan_is_refused():
    with pytest.raises(ValueError, match="must not be NaN"):
        inferred_distance(0.0, float("nan"), 0.0, DISTANCES)


def test_looks_far_on_the_straight_and_near_in_a_bend():
    path = Polyline(path_of_bends((Bend(6.0), arc(180.0, 2.5), Bend(6.0))))
    policy = CurvatureLookAhead()
    assert policy.along(path, 1.0) == pytest.approx(1.5)
    assert policy.along(path, 3.9) == pytest.approx(1.05, abs=0.02)  # bend 3 m ahead, not yet 1.5 m
    assert policy.along(path, 5.4) == pytest.approx(0.6, abs=0.02)
    assert policy.along(path, 9.0) == pytest.approx(0.6, abs=0.02)
    assert policy.along(path, 16.0) == pytest.approx(1.5)


@pytest.mark.parametrize("spacing", [0.1, 0.3])
def test_mean_curvature_of_a_circle(spacing):
    path = Polyline(circle(2.5, spacing), closed=True)
    values = [mean_curvature(path, s, 0.6) for s in np.arange(1.0, 14.0, 0.037)]
    assert values == pytest.approx([0.4] * len(values), rel=0.03)


@pytest.mark.parametrize("wrong", [{"small_m": 1.2}, {"large_m": 1.0}, {"near_m": 4.0}, {"far_m": -1.0}])
def test_distances_out_of_order_are_refused(wrong):
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"kind": "curvature", **wrong}, CurvatureLookAhead)
