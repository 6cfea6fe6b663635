# SPDX-License-Identifier: Apache-2.0
"""Batches are recognised by identifiers, lengths and buses, and by nothing else."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.addressing import AddressBook
from drivers.can_frame import FRAME_WORDS, make_frames
from drivers.patterns import Recognizer, data_words, heads


class Book(AddressBook):
    """Counts how often it is asked."""

    asked = 0

    def identify(self, frames, bus):
        self.asked += 1
        return super().identify(frames, bus)


def identify(recognizer, frames, bus=0):
    return recognizer.identify(frames.tobytes(), frames, np.full(len(frames), bus, np.uint8))


@given(st.lists(st.binary(min_size=16, max_size=16), min_size=1, max_size=20))
def test_heads_are_identifiers_and_lengths(raw):
    whole = b"".join(raw)
    expected = b"".join(frame[:5] + bytes(11) for frame in raw)
    assert heads(whole).to_bytes(len(whole), "little") == expected


def test_data_words_are_those_of_the_frames():
    frames = make_frames([1, 2], 8, b"\x01\x02\x03")
    assert (
        data_words(frames.tobytes()).tolist() == frames.view(FRAME_WORDS)["word"].tolist() == [0x0102030000000000] * 2
    )


def test_a_book_is_asked_once_for_each_pattern():
    book = Book(2, 8, {(0, 1, 0): 0, (0, 2, 0): 1}, 0)
    recognizer = Recognizer(book, id_in_data=False)
    for data in (b"", b"\x07", b"\x09\x01"):
        assert identify(recognizer, make_frames([2, 1], 8, data)).drives.tolist() == [1, 0]
    assert book.asked == 1
    assert not identify(recognizer, make_frames([2, 1], 8), bus=1).drives.size
    assert not identify(recognizer, make_frames([2, 1], 7)).drives.size
    assert identify(recognizer, make_frames([2], 8)).drives.tolist() == [1]
    assert book.asked == 4


def test_the_id_within_the_data_is_told_apart_where_there_is_one():
    recognizer = Recognizer(AddressBook(2, 8, {(0, 9, 1): 0, (0, 9, 2): 1}, 0xFF), id_in_data=True)
    assert identify(recognizer, make_frames([9], 8, b"\x01\xaa")).drives.tolist() == [0]
    assert identify(recognizer, make_frames([9], 8, b"\x02\xaa")).drives.tolist() == [1]
    assert identify(recognizer, make_frames([9], 8, b"\x03\xaa")).any_rejected


def test_irregular_traffic_does_not_fill_the_memory():
    book = Book(1, 8, {(0, 1, 0): 0}, 0)
    recognizer = Recognizer(book, id_in_data=False)
    for can_id in range(500):
        identify(recognizer, make_frames([can_id], 8))
    assert len(recognizer._known) <= 64
