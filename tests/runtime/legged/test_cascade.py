# SPDX-License-Identifier: Apache-2.0
"""Priorities are strict: what a lower task asks never costs a higher one anything."""

from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.legged.cascade import prioritised_motion

SEEDS = st.integers(0, 2**32 - 1)
SIZE = 18


class MotionTask(NamedTuple):
    """A task of some rows: its Jacobian, and what it asks."""

    jacobian: np.ndarray
    demand: np.ndarray


def motion_of(tasks):
    return prioritised_motion(np.vstack([t.jacobian for t in tasks]), np.vstack([t.demand for t in tasks]))


def task(rng, rows):
    return MotionTask(rng.standard_normal((rows, SIZE)), rng.standard_normal((rows, 3)))


def error(task, motion):
    return task.jacobian @ motion - task.demand


def conditioned(tasks, bound=1e-2):
    return np.linalg.svd(np.vstack([t.jacobian for t in tasks]), compute_uv=False).min() > bound


@given(SEEDS, st.lists(st.integers(1, 6), min_size=1, max_size=4))
def test_compatible_tasks_are_all_fulfilled_by_the_smallest_motion(seed, rows):
    rng = np.random.default_rng(seed)
    tasks = [task(rng, count) for count in rows]
    if sum(rows) > SIZE - 2 or not conditioned(tasks, 0.3):
        return
    motion = motion_of(tasks)
    stacked = np.vstack([t.jacobian for t in tasks])
    smallest = np.linalg.pinv(stacked) @ np.vstack([t.demand for t in tasks])
    np.testing.assert_allclose(motion, smallest, atol=1e-5)


@given(SEEDS, st.integers(1, 6), st.integers(1, 6))
def test_a_conflicting_lower_task_does_not_disturb_a_higher_one(seed, above, below):
    rng = np.random.default_rng(seed)
    high = task(rng, above)
    # most of the lower task's rows are combinations of the higher one's, with contrary demands
    mix = rng.standard_normal((below, above))
    low = MotionTask(mix @ high.jacobian, 10.0 * rng.standard_normal((below, 3)))
    if not conditioned([high], 0.3):
        return
    alone, both = motion_of([high]), motion_of([high, low])
    assert np.isfinite(both).all()
    np.testing.assert_allclose(error(high, both), error(high, alone), atol=1e-6)
    assert np.abs(error(high, both)).max() < 1e-5


@given(SEEDS)
def test_it_is_the_recursion_in_null_spaces(seed):
    """X_i = X_{i-1} + (J_i N_{i-1})^+ (d_i - J_i X_{i-1}), literally."""
    rng = np.random.default_rng(seed)
    tasks = [task(rng, rows) for rows in (6, 3, 3, 6)]
    motion, null_space = np.zeros((SIZE, 3)), np.eye(SIZE)
    for jacobian, demand in tasks:
        inverse = np.linalg.pinv(jacobian @ null_space)
        motion = motion + inverse @ (demand - jacobian @ motion)
        null_space = null_space - inverse @ (jacobian @ null_space)
    if not conditioned(tasks, 0.1):
        return
    np.testing.assert_allclose(motion_of(tasks), motion, atol=1e-4 * (1 + np.abs(motion).max()))


@given(SEEDS, st.floats(0.0, 1e-3))
def test_a_singular_leg_gives_a_bounded_answer(seed, remaining):
    rng = np.random.default_rng(seed)
    high, low = task(rng, 6), task(rng, 3)
    stretched = low.jacobian.copy()
    # the third row is all but the sum of the others: what it asks besides cannot be had
    stretched[2] = stretched[0] + stretched[1] + remaining * stretched[2]
    if not conditioned([high], 0.5) or not conditioned([high, MotionTask(low.jacobian, low.demand)], 0.3):
        return
    motion = motion_of([high, MotionTask(stretched, low.demand)])
    assert np.isfinite(motion).all()
    # a damped inverse amplifies by at most 1 / (2 damping)
    assert np.abs(motion).max() < 1e5
    np.testing.assert_allclose(error(high, motion), 0.0, atol=1e-4)


@given(SEEDS)
def test_the_same_task_twice_is_the_same_as_once(seed):
    rng = np.random.default_rng(seed)
    one = task(rng, 5)
    if not conditioned([one], 0.3):
        return
    np.testing.assert_allclose(motion_of([one, one]), motion_of([one]), atol=1e-5)
