# SPDX-License-Identifier: Apache-2.0
"""No command that became too old on its way reaches a bus."""

from hypothesis import given
from hypothesis import strategies as st

from runtime.robots.fresh_frames import FreshFrames
from runtime.signals import CanFrames

SIZES = {"frame": 4, "frame_byte": 64}
BOUND_NS = 10_000_000


class Wire(list):
    def write(self, record, now_ns):
        self.append(now_ns - record.stamp_ns)


@given(st.lists(st.integers(0, 3 * BOUND_NS), max_size=20))
def test_only_what_is_fresh_passes_and_the_rest_is_counted(ages):
    wire, frames = Wire(), CanFrames("/frames", SIZES)
    gate = FreshFrames(wire, BOUND_NS)
    for age_ns in ages:
        frames.stamp_ns = 10**9
        gate.write(frames, 10**9 + age_ns)
    assert list(wire) == [age_ns for age_ns in ages if age_ns <= BOUND_NS]
    assert gate.stale == len(ages) - len(wire)
