# SPDX-License-Identifier: Apache-2.0
"""What is kept of one sender has nothing to do with another, and there is room for so many."""

from __future__ import annotations

from runtime.link.per_source import MOST_SOURCES, PerSource


def test_each_source_has_its_own():
    kept: PerSource[list[int]] = PerSource(list)
    kept.of(1).append(5)
    assert (kept.of(1), kept.of(2)) == ([5], [])


def test_of_more_sources_than_are_kept_the_one_not_asked_for_the_longest_is_forgotten():
    kept: PerSource[list[int]] = PerSource(list)
    for source in range(MOST_SOURCES):
        kept.of(source).append(source)
    kept.of(0)
    kept.of(MOST_SOURCES)
    assert kept.of(0) == [0]
    assert kept.of(2) == [2]
    assert kept.of(1) == []
