# SPDX-License-Identifier: Apache-2.0
"""The checksum is CRC-8 SAE J1850, and betrays what a bus does to frames."""

from crccheck.crc import Crc8SaeJ1850
from hypothesis import given
from hypothesis import strategies as st

from drivers.checksum import crc8


def test_check_value_of_the_standard():
    assert crc8(b"123456789") == 0x4B


@given(st.binary(max_size=20))
def test_it_agrees_with_an_independent_implementation(data):
    assert crc8(data) == Crc8SaeJ1850.calc(data)


@given(st.binary(min_size=1, max_size=12), st.data())
def test_it_sees_any_burst_of_up_to_8_bits(data, draw):
    burst = draw.draw(st.integers(1, 255))
    shift = draw.draw(st.integers(0, 8 * len(data) - burst.bit_length()))
    changed = int.from_bytes(data, "big") ^ burst << shift
    assert crc8(changed.to_bytes(len(data), "big")) != crc8(data)
