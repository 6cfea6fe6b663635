# SPDX-License-Identifier: Apache-2.0
"""All publishers of a session are one source, as far as that can be known."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from runtime.link.senders import MOST_TOKENS, SenderBook, number_of
from runtime.messages import definitions
from runtime.messages.keys import Node, gid_of

ARM, MOTION = "/operator/arm", "/operator/motion"
ALONE = 12345


def token(session: str, topic: str, number: int = 1) -> str:
    return Node(0, session, "panel").endpoint_token(number, "MP", topic, definitions.STRING)


def gid(number: int) -> bytes:
    return number.to_bytes(16, "big")


def test_publishers_of_one_session_are_one_source():
    book = SenderBook()
    book.note(token("a", ARM), True)
    book.note(token("a", MOTION, 2), True)
    assert book.source(ARM, gid(1), ALONE) == book.source(MOTION, gid(2), ALONE) == number_of("a")


def test_a_publisher_without_a_token_stands_for_itself():
    assert SenderBook().source(ARM, gid(1), ALONE) == ALONE


def test_a_second_session_is_told_from_the_first():
    book = SenderBook()
    book.note(token("a", ARM), True)
    assert book.source(ARM, gid(1), ALONE) == number_of("a")
    book.note(token("b", ARM), True)
    assert book.source(ARM, gid(2), ALONE) == number_of("b")
    assert book.source(ARM, gid(1), ALONE) == number_of("a")
    assert book.source(ARM, gid(3), ALONE) == ALONE, "nobody is left whose it could be"


def test_two_sessions_that_were_never_seen_apart_stand_for_themselves():
    book = SenderBook()
    book.note(token("a", ARM), True)
    book.note(token("b", ARM), True)
    assert book.source(ARM, gid(1), 1) == 1
    assert book.source(ARM, gid(2), 2) == 2


def test_a_session_that_ended_is_forgotten():
    book = SenderBook()
    book.note(token("a", ARM), True)
    book.source(ARM, gid(1), ALONE)
    book.note(token("a", ARM), False)
    assert book.source(ARM, gid(1), ALONE) == ALONE
    book.note(token("b", ARM), True)
    assert book.source(ARM, gid(2), ALONE) == number_of("b")


def test_panels_that_were_there_before_either_spoke_are_told_apart_by_the_hashes_of_their_tokens():
    book = SenderBook()
    tokens = {(panel, topic): token(panel, topic) for panel in "ab" for topic in (ARM, MOTION)}
    for one in tokens.values():
        book.note(one, True)
    found = {(panel, topic): book.source(topic, gid_of(one), ALONE) for (panel, topic), one in tokens.items()}
    assert found == {(panel, topic): number_of(panel) for panel, topic in tokens}


def test_what_a_session_that_hashes_its_tokens_did_not_send_is_never_taken_for_its_own():
    book = SenderBook()
    for topic in (ARM, MOTION):
        book.note(token("a", topic), True)
    assert book.source(ARM, gid_of(token("a", ARM)), ALONE) == number_of("a")
    assert book.source(MOTION, gid(1), ALONE) == ALONE, "it is known from another topic"
    book.note(token("b", MOTION), True)
    assert book.source(MOTION, gid(1), ALONE) == number_of("b")
    assert book.source(MOTION, gid_of(token("a", MOTION)), ALONE) == number_of("a")


def test_the_hash_of_a_token_holds_for_its_topic_alone():
    book = SenderBook()
    book.note(token("a", ARM), True)
    assert book.source(MOTION, gid_of(token("a", ARM)), ALONE) == ALONE


def test_a_guess_is_taken_back_when_the_token_comes():
    book = SenderBook()
    book.note(token("b", ARM), True)
    assert book.source(ARM, gid_of(token("a", ARM)), ALONE) == number_of("b"), "nobody else was there"
    book.note(token("a", ARM), True)
    assert book.source(ARM, gid_of(token("a", ARM)), ALONE) == number_of("a")
    assert book.source(ARM, gid(1), ALONE) == number_of("b")


def test_a_token_that_ended_gives_its_hash_no_session():
    book = SenderBook()
    book.note(token("a", ARM), True)
    book.source(ARM, gid_of(token("a", ARM)), ALONE)
    book.note(token("a", ARM), False)
    assert book.source(ARM, gid_of(token("a", ARM)), ALONE) == ALONE


@given(st.lists(st.tuples(st.text(max_size=40), st.booleans()), max_size=50))
def test_any_text_may_be_a_token(tokens):
    book = SenderBook()
    for text, alive in tokens:
        book.note(text, alive)
        book.note(f"@ros2_lv/0/{text}/0/1/MP/%/%/panel/%operator%arm/t/h/q", alive)
    assert 0 <= book.source(ARM, gid(1), ALONE) < 1 << 63


def test_tokens_without_number_find_an_end():
    book = SenderBook()
    for number in range(MOST_TOKENS + 5):
        book.note(token("a", ARM, number), True)
    assert book.overlooked == 5
