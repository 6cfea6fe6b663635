# SPDX-License-Identifier: Apache-2.0
"""Requests leave in their order and at a bounded rate, and an emergency stop waits for none of them."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.link.event_outlet import BURST, MOST_WAITING, Event, EventOutlet
from runtime.link.rate_gate import RateGate
from runtime.messages.errors import MessageError
from runtime.signals import Motion, OperatorEvent, Request

TICK_HZ = 500
TICK_NS = 1_000_000_000 // TICK_HZ


class Ring:
    """What was written, as (request, source), and a control loop that takes one a tick."""

    def __init__(self) -> None:
        self.written: list[tuple[int, int]] = []
        self.taken = 0
        self.most_waiting = 0

    def write(self, record: OperatorEvent) -> None:
        self.written.append((record.request, record.source))
        self.most_waiting = max(self.most_waiting, len(self.written) - self.taken)

    def tick(self) -> None:
        self.taken = min(self.taken + 1, len(self.written))


def outlet() -> tuple[EventOutlet, Ring]:
    ring = Ring()
    return EventOutlet(OperatorEvent("/event"), ring.write, TICK_HZ), ring


def event(request: Request, source: int = 1) -> Event:
    return Event(7, source, 20, request)


def busy_outlet() -> tuple[EventOutlet, Ring]:
    """One that has let go what leaves at once."""
    way_out, ring = outlet()
    for _ in range(BURST):
        way_out.offer(event(Request.LIFE), 0)
    return way_out, ring


def empty(way_out: EventOutlet) -> None:
    for step in range(20):
        way_out.flush(step * TICK_NS)


def test_a_request_leaves_at_once_with_all_it_says():
    seen = []
    way_out = EventOutlet(OperatorEvent("/event"), lambda record: seen.append(record.to_bytes()), TICK_HZ)
    way_out.offer(Event(7, 5, 20, Request.MOTION, Motion.WALK, (0.1, 0.2, 0.3)), 0)
    record = OperatorEvent("/event")
    record.load(seen[0])
    assert (record.stamp_ns, record.source, record.priority) == (7, 5, 20)
    assert (record.request, record.motion) == (Request.MOTION, Motion.WALK)
    assert record.velocity.tolist() == [0.1, 0.2, 0.3]


def test_requests_of_the_same_moment_are_told_apart_by_their_numbers():
    seen = []
    way_out = EventOutlet(OperatorEvent("/event"), lambda record: seen.append(record.sequence), TICK_HZ)
    for request in (Request.LIFE, Request.MOTION):
        way_out.offer(Event(7, 5, 20, request), 0)
    assert seen == [1, 2]


def test_requests_that_come_at_once_leave_in_their_order():
    way_out, ring = outlet()
    asked = (Request.ARM, Request.MOTION, Request.RESET, Request.LIFE, Request.DISARM, Request.RELEASE)
    for request in asked:
        way_out.offer(event(request), 0)
    empty(way_out)
    assert [request for request, _ in ring.written] == list(asked)


def test_of_requests_that_wait_the_newest_of_a_kind_counts():
    way_out, ring = busy_outlet()
    for request in (Request.ARM, Request.DISARM, Request.ARM):
        way_out.offer(event(request), 0)
    empty(way_out)
    assert [request for request, _ in ring.written[BURST:]] == [Request.DISARM, Request.ARM]
    assert way_out.merged == 1
    assert way_out.waiting == 0


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 3), st.sampled_from(Request), st.integers(0, 200)), max_size=400),
    st.integers(0, 400),
)
def test_before_an_emergency_stop_there_are_never_more_than_a_few(flood, when):
    way_out, ring = outlet()
    now_ns, stopped_at = 0, None
    for number, (source, request, gap_us) in enumerate(flood):
        now_ns += gap_us * 1000
        while ring.taken < len(ring.written) and ring.taken * TICK_NS < now_ns:
            ring.tick()
        if number == when:
            before = len(ring.written)
            way_out.offer(event(Request.EMERGENCY_STOP, 9), now_ns)
            stopped_at = before - ring.taken
        elif request != Request.EMERGENCY_STOP:
            way_out.offer(event(request, source), now_ns)
    if stopped_at is not None:
        assert any(request == Request.EMERGENCY_STOP for request, _ in ring.written), "it left at once"
        assert stopped_at <= 2 * BURST


def test_a_flood_never_writes_faster_than_the_control_loop_takes():
    way_out, ring = outlet()
    for tick in range(500):
        for source in range(8):
            for request in Request:
                way_out.offer(event(request, source), tick * TICK_NS)
        ring.tick()
    assert ring.most_waiting <= 2 * BURST + 1
    assert way_out.merged > 0


def test_an_emergency_stop_passes_when_nothing_else_finds_room():
    way_out, ring = outlet()
    with pytest.raises(MessageError, match="too many requests wait"):
        for source in range(BURST + MOST_WAITING + 1):
            way_out.offer(event(Request.LIFE, source), 0)
    way_out.offer(event(Request.EMERGENCY_STOP, 999), 0)
    assert ring.written[-1] == (Request.EMERGENCY_STOP, 999)


def test_a_reset_that_an_emergency_stop_overtakes_does_not_undo_it():
    way_out, ring = busy_outlet()
    for request in (Request.RESET, Request.ARM, Request.EMERGENCY_STOP):
        way_out.offer(event(request), 0)
    empty(way_out)
    assert [request for request, _ in ring.written[BURST:]] == [Request.EMERGENCY_STOP, Request.ARM]
    assert way_out.merged == 1
    way_out.offer(event(Request.RESET), TICK_NS * 20)
    assert ring.written[-1] == (Request.RESET, 1)


@given(st.lists(st.integers(0, 3_000_000), min_size=1, max_size=300), st.integers(1, 2000), st.integers(1, 10))
def test_a_gate_keeps_its_rate_and_lets_a_burst_through(gaps_ns, rate_hz, burst):
    gate, now_ns, passed = RateGate(rate_hz, burst), 0, 0
    assert [gate.passes(0) for _ in range(burst + 1)] == [True] * burst + [False]
    for gap_ns in gaps_ns:
        now_ns += gap_ns
        passed += gate.passes(now_ns)
    assert passed <= now_ns * rate_hz / 1e9 + 1e-6 * len(gaps_ns) + 1
