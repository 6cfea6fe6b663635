# SPDX-License-Identifier: Apache-2.0
"""The frame layout is Linux's, and a frame's time on the bus is ISO 11898-1's."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_frame import (
    CAN_EFF_FLAG,
    CAN_FRAME,
    CAN_RTR_FLAG,
    arbitration_priority,
    as_frames,
    frame_bits,
    make_frames,
    max_frame_bits,
    min_frame_bits,
)
from drivers.errors import FrameError


def test_a_frame_has_the_bytes_of_struct_can_frame():
    frames = make_frames([0x123, 0x901 | CAN_EFF_FLAG], 3, b"\x01\x02\x03")
    expected = [struct.pack("<IB3x8s", can_id, 3, b"\x01\x02\x03") for can_id in (0x123, 0x80000901)]
    assert frames.tobytes() == b"".join(expected)


def test_a_batch_is_a_view_of_its_bytes():
    data = np.zeros(32, np.uint8)
    frames = as_frames(data)
    frames["can_id"][1] = 0x7FF
    assert frames.dtype == CAN_FRAME
    assert data[16:18].tolist() == [0xFF, 0x07]


def test_bytes_that_are_no_whole_frames_are_refused():
    with pytest.raises(FrameError, match="17 bytes"):
        as_frames(np.zeros(17, np.uint8))
    with pytest.raises(FrameError, match="at most 8"):
        make_frames([1], 9)


@pytest.mark.parametrize(("extended", "least", "most"), [(False, 111, 135), (True, 131, 160)])
def test_eight_byte_frames_have_the_known_lengths(extended, least, most):
    assert (min_frame_bits(8, extended), max_frame_bits(8, extended)) == (least, most)


@given(st.integers(0, 0x1FFFFFFF), st.booleans(), st.binary(max_size=8))
def test_the_exact_length_is_between_the_bounds(identifier, extended, data):
    can_id = identifier | CAN_EFF_FLAG if extended else identifier & 0x7FF
    assert min_frame_bits(len(data), extended) <= frame_bits(can_id, data) <= max_frame_bits(len(data), extended)


def test_all_zeros_stuff_every_fifth_bit():
    # Identifier 0 without data: start, 11 + 3 + 4 header bits and a CRC of zero are 34 zeros, and every fifth is
    # followed by a one: six in all.
    assert frame_bits(0, b"") == 34 + 6 + 13


def test_arbitration_prefers_low_ids_then_data_then_standard_frames():
    extended_of_1 = (1 << 18) | CAN_EFF_FLAG
    in_order = [0x000, 0x001, 0x001 | CAN_RTR_FLAG, extended_of_1, extended_of_1 | CAN_RTR_FLAG, 0x002, 0x7FF]
    priorities = [arbitration_priority(can_id) for can_id in in_order]
    assert priorities == sorted(priorities)
    assert len(set(priorities)) == len(priorities)
