# SPDX-License-Identifier: Apache-2.0
"""The schedule: diagonals move together, feet stand for their share, and no step straddles a change of contacts."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import table_of
from runtime.legged.gait import GaitConfig, foot_phases, knots, phase_progress, scheduled_stance

MS = 1_000_000
CONFIGS = st.sampled_from([(400, 0.5, 10), (400, 0.6, 10), (500, 0.8, 10), (480, 0.75, 16), (320, 0.625, 16)])
TIMES = st.integers(-(10**10), 10**13)


def schedule_at(config, start_ns, now_ns):
    """Phases and scheduled stance of the feet."""
    row = table_of(config)[0]
    phases = foot_phases(row, start_ns, now_ns)
    return phases, scheduled_stance(row, phases)


def stance_at(config, start_ns, now_ns):
    return schedule_at(config, start_ns, now_ns)[1]


@given(CONFIGS, TIMES, st.integers(0, 10**10))
def test_diagonal_feet_do_the_same_half_a_cycle_apart(setting, start_ns, elapsed_ns):
    config = GaitConfig(setting[0] * MS, setting[1])
    phases = schedule_at(config, start_ns, start_ns + elapsed_ns)[0]
    left_front, right_front, left_hind, right_hind = phases
    assert (left_front, right_front) == (right_hind, left_hind)
    assert (left_front - right_front) % 1.0 == pytest.approx(0.5)
    assert (phases >= 0.0).all()
    assert (phases < 1.0).all()


@pytest.mark.parametrize("duty", [0.5, 0.6, 0.7, 0.8])
def test_each_foot_stands_for_its_share_of_the_cycle(duty):
    config = GaitConfig(400 * MS, duty)
    stance = np.array([stance_at(config, 0, t) for t in range(0, 400 * MS, 50_000)])
    np.testing.assert_allclose(stance.mean(axis=0), duty, atol=2e-4)
    # no more than one change each way in a cycle, and always a diagonal on the ground
    assert (np.abs(np.diff(stance.astype(int), axis=0)).sum(axis=0) <= 2).all()
    assert (stance[:, [0, 3]].all(axis=1) | stance[:, [1, 2]].all(axis=1)).all()
    assert config.stance_s + config.swing_s == pytest.approx(0.4)


@given(CONFIGS, st.integers(0, 10**10))
def test_progress_runs_from_0_to_1_in_stance_and_in_swing(setting, now_ns):
    config = GaitConfig(setting[0] * MS, setting[1])
    phases, stance = schedule_at(config, 0, now_ns)
    progress = phase_progress(table_of(config)[0], phases)
    assert (progress >= 0.0).all()
    assert (progress <= 1.0).all()
    elapsed = np.where(stance, progress * config.stance_s, config.stance_s + progress * config.swing_s)
    np.testing.assert_allclose(elapsed, np.array(phases) * config.period_ns * 1e-9, atol=1e-9)


@given(CONFIGS, TIMES, st.integers(0, 2 * 10**9))
def test_no_step_of_the_horizon_straddles_a_change_of_contacts(setting, start_ns, elapsed_ns):
    period_ms, duty, steps = setting
    config = GaitConfig(period_ms * MS, duty)
    begin_ns = start_ns + elapsed_ns
    boundaries = knots(table_of(config)[0], start_ns, begin_ns, steps)
    assert boundaries[0] == begin_ns
    assert len(boundaries) == steps + 1
    lengths = np.diff(boundaries)
    assert (lengths > 0).all()
    assert (lengths <= config.period_ns // steps).all()
    assert (lengths[1:] == config.period_ns // steps).all()
    for low, high in itertools.pairwise(boundaries):
        inside = [stance_at(config, start_ns, t).tolist() for t in (low, (low + high) // 2, high - 1)]
        assert inside[0] == inside[1] == inside[2]


@given(TIMES, st.integers(0, 10**9))
def test_the_horizon_spans_the_gait_cycle_but_for_the_step_that_has_begun(start_ns, elapsed_ns):
    config = GaitConfig(400 * MS, 0.5)
    boundaries = knots(table_of(config)[0], start_ns, start_ns + elapsed_ns, 10)
    assert 360 * MS < boundaries[-1] - boundaries[0] <= 400 * MS
