# SPDX-License-Identifier: Apache-2.0
"""Buses in virtual time: transmission times, arbitration, loss, tampering, and the ports on them."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_frame import CAN_EFF_FLAG, make_frames
from drivers.errors import DriverConfigError, FrameError
from drivers.memory_bus import End, MemoryBus
from drivers.memory_ports import MemoryReader, MemoryWriter

FRAME_NS = 135_000
EXTENDED_NS = 160_000
LATE = 10**9


def send(bus, ids, at_ns=0, end=End.HOST, wires=None):
    wires = np.zeros(len(ids), np.uint8) if wires is None else np.array(wires, np.uint8)
    bus.send(end, wires, make_frames(ids, 8), at_ns)


def batch(capacity=4):
    return SimpleNamespace(
        stamp_ns=0,
        count=0,
        lost=0,
        bus=np.zeros(capacity, np.uint8),
        arrival_ns=np.zeros(capacity, np.int64),
        data=np.zeros(16 * capacity, np.uint8),
    )


def test_a_frame_arrives_after_its_transmission_and_not_before():
    bus = MemoryBus(1)
    send(bus, [5], at_ns=1000)
    assert len(bus.receive(End.DEVICE, 1000 + FRAME_NS - 1).frames) == 0
    received = bus.receive(End.DEVICE, 1000 + FRAME_NS)
    assert received.arrival_ns.tolist() == [1000 + FRAME_NS]
    assert received.frames.tobytes() == make_frames([5], 8).tobytes()
    assert len(bus.receive(End.DEVICE, LATE).frames) == 0


def test_frames_of_one_bus_follow_each_other_and_buses_work_side_by_side():
    bus = MemoryBus(2)
    send(bus, [1, 2, 1], wires=[0, 0, 1])
    received = bus.receive(End.DEVICE, LATE)
    assert received.arrival_ns.tolist() == [FRAME_NS, FRAME_NS, 2 * FRAME_NS]
    assert received.bus.tolist() == [0, 1, 0]


def test_the_lowest_identifier_goes_first_and_never_interrupts():
    bus = MemoryBus(1)
    send(bus, [9, 3, 7])
    send(bus, [1], at_ns=1)
    send(bus, [5], at_ns=FRAME_NS, end=End.DEVICE)
    assert bus.receive(End.DEVICE, LATE).frames["can_id"].tolist() == [3, 1, 7, 9]
    assert bus.receive(End.HOST, LATE).arrival_ns.tolist() == [3 * FRAME_NS]


def test_extended_frames_take_longer_and_rates_scale():
    bus = MemoryBus(1, bit_rate=500_000)
    send(bus, [0x801 | CAN_EFF_FLAG])
    assert bus.receive(End.DEVICE, LATE).arrival_ns.tolist() == [2 * EXTENDED_NS]


def test_the_answer_does_not_depend_on_how_often_one_asks():
    def arrivals(stops):
        bus = MemoryBus(1)
        send(bus, [4, 2, 3], at_ns=10)
        send(bus, [1], at_ns=200_000)
        parts = [bus.receive(End.DEVICE, stop) for stop in stops]
        return [(t, i) for p in parts for t, i in zip(p.arrival_ns.tolist(), p.frames["can_id"].tolist(), strict=True)]

    assert arrivals([LATE]) == arrivals(list(range(0, 1_000_000, 7_000)))


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.integers(0, 2_000_000), st.integers(0, 2)), max_size=40))
def test_no_bus_carries_two_frames_at_once_and_none_is_lost(frames):
    bus = MemoryBus(3)
    for can_id, at_ns, wire in frames:
        send(bus, [can_id], at_ns, wires=[wire])
    received = bus.receive(End.DEVICE, LATE)
    assert sorted(received.frames["can_id"].tolist()) == sorted(can_id for can_id, _, _ in frames)
    assert (np.diff(received.arrival_ns) >= 0).all()
    for wire in range(3):
        assert (np.diff(received.arrival_ns[received.bus == wire]) >= FRAME_NS).all()


def plain_arrivals(sent, until_ns):
    """(arrival, wire, id) by the rule alone: of what waits when a wire falls free the lowest id goes first."""
    arrivals = []
    for wire in {wire for _, _, wire in sent}:
        waiting, now_ns = [(can_id, order, at_ns) for order, (can_id, at_ns, w) in enumerate(sent) if w == wire], 0
        while waiting:
            now_ns = max(now_ns, min(at_ns for _, _, at_ns in waiting))
            first = min(frame for frame in waiting if frame[2] <= now_ns)
            waiting.remove(first)
            now_ns += FRAME_NS
            if now_ns <= until_ns:
                arrivals.append((now_ns, wire, first[0]))
    return sorted(arrivals)


@given(
    st.lists(st.tuples(st.integers(0, 0x7FF), st.integers(0, 1_000_000), st.integers(0, 2)), max_size=15),
    st.lists(st.integers(0, 3_000_000), max_size=4),
    st.integers(0, 10**15),
)
def test_arrivals_follow_the_rule_at_any_time_and_however_often_one_asks(frames, stops, epoch_ns):
    bus = MemoryBus(3)
    bus.receive(End.DEVICE, epoch_ns)
    for can_id, at_ns, wire in frames:
        send(bus, [can_id], epoch_ns + at_ns, wires=[wire])
    seen = []
    for stop in [*sorted(stops), LATE]:
        received = bus.receive(End.DEVICE, epoch_ns + stop)
        columns = (received.arrival_ns - epoch_ns, received.bus, received.frames["can_id"])
        seen += list(zip(*(column.tolist() for column in columns), strict=True))
    assert seen == plain_arrivals(frames, LATE)


def test_the_same_traffic_takes_the_same_times_in_every_period():
    bus, seen = MemoryBus(2), []
    for start_ns in range(0, 20_000_000, 2_000_000):
        send(bus, [3, 1, 2, 1], start_ns + 800_000, wires=[0, 0, 0, 1])
        for step_ns in (1_000_000, 2_000_000):
            frames, wires, arrival_ns = bus.receive(End.DEVICE, start_ns + step_ns)
            bus.send(End.DEVICE, wires, frames, arrival_ns)
        replies = bus.receive(End.HOST, start_ns + 2_000_000)
        seen.append((replies.frames["can_id"].tolist(), (replies.arrival_ns - start_ns).tolist()))
    assert seen == [seen[0]] * 10
    assert seen[0] == ([1, 1, 2, 3], [1_070_000, 1_070_000, 1_475_000, 1_610_000])
    assert bus._timetable.send.cache_info().misses < 10
    assert bus._timetable.receive.cache_info().misses < 10


def test_overflow_is_counted_at_the_end_that_suffers():
    bus = MemoryBus(1, queue_capacity=3, receive_capacity=2)
    send(bus, [1, 2, 3, 4, 5])
    assert (bus.lost(End.HOST), bus.lost(End.DEVICE)) == (2, 0)
    assert bus.receive(End.DEVICE, LATE).frames["can_id"].tolist() == [1, 2]
    assert (bus.lost(End.HOST), bus.lost(End.DEVICE)) == (2, 1)
    send(bus, [6])
    assert bus.lost(End.HOST) == 2


def test_tampering_alters_or_destroys():
    seen = []

    def tamper(sender, wire, arrival_ns, frame):
        seen.append((sender, wire, arrival_ns))
        return None if frame[0] == 1 else frame[:8] + b"\xaa" + frame[9:]

    bus = MemoryBus(1, tamper=tamper)
    send(bus, [1, 2])
    received = bus.receive(End.DEVICE, LATE)
    assert received.frames["data"][:, 0].tolist() == [0xAA]
    assert seen == [(End.HOST, 0, FRAME_NS), (End.HOST, 0, 2 * FRAME_NS)]
    bus.tamper = lambda sender, wire, arrival_ns, frame: frame[:15]
    send(bus, [1])
    with pytest.raises(FrameError, match="15 bytes"):
        bus.receive(End.DEVICE, 2 * LATE)


def test_what_does_not_exist_is_refused():
    bus = MemoryBus(1)
    with pytest.raises(FrameError, match="no bus 1"):
        send(bus, [1, 2], wires=[0, 1])
    assert len(bus.receive(End.DEVICE, LATE).frames) == 0
    with pytest.raises(DriverConfigError, match="0 buses"):
        MemoryBus(0)


def test_ports_carry_a_batch_out_and_back():
    bus = MemoryBus(2)
    outgoing, incoming = batch(), batch()
    outgoing.count = 2
    outgoing.bus[:2] = [0, 1]
    outgoing.data[:32] = make_frames([7, 8], 8, b"\x01\x02").view(np.uint8)
    MemoryWriter(bus).write(outgoing, 500)
    arrived = bus.receive(End.DEVICE, LATE)
    assert arrived.frames["can_id"].tolist() == [7, 8]
    bus.send(End.DEVICE, arrived.bus, arrived.frames, arrived.arrival_ns)
    assert MemoryReader(bus).read(incoming, LATE)
    assert (incoming.stamp_ns, incoming.count, incoming.lost) == (LATE, 2, 0)
    assert incoming.bus.tolist() == [0, 1, 0, 0]
    assert incoming.arrival_ns.tolist() == [500 + 2 * FRAME_NS] * 2 + [0, 0]
    assert incoming.data.tobytes() == outgoing.data.tobytes()


def test_an_empty_read_empties_the_batch_once():
    bus, record = MemoryBus(1), batch()
    reader = MemoryReader(bus)
    assert not reader.read(record, 1)
    assert record.stamp_ns == 0
    send(bus, [1], end=End.DEVICE)
    assert reader.read(record, FRAME_NS)
    assert reader.read(record, FRAME_NS + 1)
    assert (record.count, record.stamp_ns) == (0, FRAME_NS + 1)
    assert not record.data.any()
    assert not record.arrival_ns.any()
    assert not reader.read(record, FRAME_NS + 2)
    assert record.stamp_ns == FRAME_NS + 1


def test_what_does_not_fit_waits():
    bus, record = MemoryBus(1), batch(2)
    send(bus, [1, 2, 3], end=End.DEVICE)
    reader = MemoryReader(bus)
    reader.read(record, LATE)
    assert record.count == 2
    reader.read(record, LATE)
    assert (record.count, record.data[0]) == (1, 3)


def test_a_batch_that_claims_too_much_is_refused():
    record = batch(2)
    record.count = 3
    with pytest.raises(FrameError, match="for 2 frames claims to hold 3"):
        MemoryWriter(MemoryBus(1)).write(record, 0)
