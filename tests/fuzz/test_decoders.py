# SPDX-License-Identifier: Apache-2.0
"""Whatever bytes come, a decoder takes them or refuses them with a sentence of ours; it neither crashes nor hangs."""

from __future__ import annotations

import random
from contextlib import suppress

import pytest
from fuzz_target import OURS, Target
from fuzz_targets import TARGETS, mutated
from hypothesis import given, settings
from hypothesis import strategies as st


def name_of(target: Target) -> str:
    return target.name


@pytest.mark.parametrize("target", TARGETS, ids=name_of)
def test_the_seeds_are_valid(target):
    """Or what is made of them would be refused at its first byte."""
    taken = 0
    for seed in target.seeds():
        with suppress(*OURS):
            target.decode(seed)
            taken += 1
    assert taken


@pytest.mark.parametrize("target", TARGETS, ids=name_of)
@settings(max_examples=60)
@given(data=st.binary(max_size=200), kind=st.integers(0, 9), number=st.integers(0, 2**32))
def test_no_input_does_more_than_be_refused(target, data, kind, number):
    choice = random.Random(number)
    given_bytes = data if kind == 0 else mutated(choice.choice(target.seeds()), choice)
    with suppress(*OURS):
        target.decode(given_bytes)
