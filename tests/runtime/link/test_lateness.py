# SPDX-License-Identifier: Apache-2.0
"""A message that waited in the network is known to be late, though the clocks at both ends have nothing in common."""

from hypothesis import given
from hypothesis import strategies as st

from runtime.link.lateness import DRIFT, Lateness

MS = 1_000_000
OFFSETS = st.integers(-(10**18), 10**18)


@given(OFFSETS, st.lists(st.integers(0, 20 * MS), min_size=1, max_size=50))
def test_messages_that_flow_are_no_later_than_the_network_is_uneven(offset_ns, delays_ns):
    lateness = Lateness()
    for number, delay_ns in enumerate(delays_ns):
        sent_ns = number * 100 * MS
        assert 0 <= lateness.of(sent_ns, sent_ns + offset_ns + delay_ns) <= 20 * MS


@given(OFFSETS, st.integers(7, 100))
def test_what_was_held_back_is_late_by_as_long_as_it_was(offset_ns, count):
    lateness = Lateness()
    lateness.of(0, offset_ns)
    mended_ns = count * 100 * MS
    for number in range(1, count + 1):
        sent_ns = number * 100 * MS
        waited_ns = mended_ns - sent_ns
        assert waited_ns - mended_ns // DRIFT <= lateness.of(sent_ns, mended_ns + offset_ns) <= waited_ns


@given(OFFSETS, st.integers(-500, 500))
def test_a_clock_that_drifts_makes_nothing_late(offset_ns, parts_per_million):
    lateness = Lateness()
    for second in range(0, 100_000, 1000):
        arrival_ns = second * 1000 * MS
        sent_ns = arrival_ns + offset_ns + arrival_ns * parts_per_million // 1_000_000
        assert lateness.of(sent_ns, arrival_ns) == 0


@given(OFFSETS, st.integers(-(10**15), 10**15), st.integers(1, 3600))
def test_a_clock_that_is_set_makes_at_most_one_message_late(offset_ns, step_ns, apart_s):
    lateness, late = Lateness(), []
    for number in range(8):
        arrival_ns = number * apart_s * 1000 * MS
        sent_ns = arrival_ns + offset_ns + (step_ns if number > 3 else 0)
        late.append(lateness.of(sent_ns, arrival_ns))
    assert late[:4] == [0] * 4
    assert late[5:] == [0] * 3
