# SPDX-License-Identifier: Apache-2.0
"""What error frames say of a bus, and how it is reported, on real buses and in lockstep alike."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus_health import BusHealth, BusMonitor, BusState, heed_errors, state_after
from drivers.can_frame import CAN_ERR_FLAG, make_frames
from drivers.frame_batch import content, fill
from drivers.memory_bus import End, MemoryBus
from drivers.memory_ports import MemoryReader
from runtime import signals

LATE = 10**9


def batch(capacity=8):
    return SimpleNamespace(
        stamp_ns=0,
        count=0,
        lost=0,
        bus=np.zeros(capacity, np.uint8),
        arrival_ns=np.zeros(capacity, np.int64),
        data=np.zeros(16 * capacity, np.uint8),
    )


def error(classes, controller=0):
    return make_frames([CAN_ERR_FLAG | classes], 8, bytes([0, controller])).tobytes()


# -- error frames -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "state"),
    [
        (error(0x40), BusState.OFF),
        (error(0x40 | 0x100), BusState.OFF),
        (error(0x04, 0x10), BusState.PASSIVE),
        (error(0x04, 0x20), BusState.PASSIVE),
        (error(0x04 | 0x08, 0x30), BusState.PASSIVE),
        (error(0x04, 0x08), BusState.UP),
        (error(0x04, 0x40), BusState.UP),
        (error(0x100), BusState.UP),
    ],
)
@pytest.mark.parametrize("before", [BusState.UP, BusState.PASSIVE, BusState.OFF])
def test_a_controller_tells_its_state(frame, state, before):
    assert state_after(before, frame) == state


@pytest.mark.parametrize("frame", [error(0x01), error(0x02), error(0x04, 0x01), error(0x08), error(0x20), error(0x80)])
@pytest.mark.parametrize("before", [BusState.UP, BusState.PASSIVE, BusState.OFF])
def test_other_errors_leave_the_state(frame, before):
    assert state_after(before, frame) == before


def test_a_link_that_is_down_stays_down_whatever_its_controller_said():
    health = BusHealth(state=BusState.DOWN)
    health.heed(error(0x100))
    assert (health.state, health.errors) == (BusState.DOWN, 1)


@given(st.lists(st.tuples(st.integers(0, 1), st.binary(min_size=16, max_size=16)), max_size=20))
def test_errors_are_counted_at_their_buses_and_nothing_else_is(frames):
    health = [BusHealth(), BusHealth()]
    heed_errors(b"".join(frame for _, frame in frames), [bus for bus, _ in frames], health)
    for index in range(2):
        errors = [f for bus, f in frames if bus == index and int.from_bytes(f[:4], "little") & CAN_ERR_FLAG]
        assert health[index].errors == len(errors)
        state = BusState.UP
        for frame in errors:
            state = state_after(state, frame)
        assert health[index].state == state


# -- reporting --------------------------------------------------------------------------------------------------------


def test_the_record_of_the_loops_is_such_a_report():
    assert [(state.name, state.value) for state in BusState] == [(s.name, s.value) for s in signals.BusState]
    record = signals.BusStatus("bus_status", {"bus": 2})
    health = [BusHealth(), BusHealth(BusState.OFF, True, 1, 2, 3, 4, 5, 2**32 + 6, 7)]
    monitor = BusMonitor(health)
    assert monitor.read(record, 1)
    names = ["state", "backlog", "refused", "failed", "malformed", "errors", "overflow", "purged", "withheld"]
    assert [getattr(record, name).tolist() for name in names] == [[0, each] for each in (2, True, 1, 2, 3, 4, 5, 6, 7)]


def test_only_what_changed_is_reported():
    record, health = signals.BusStatus("bus_status", {"bus": 2}), [BusHealth(), BusHealth()]
    monitor = BusMonitor(health)
    assert not monitor.read(record, 1)
    health[1].refused += 1
    assert monitor.read(record, 2)
    assert not monitor.read(record, 3)
    assert record.refused.tolist() == [0, 1]


# -- in lockstep ------------------------------------------------------------------------------------------------------


def rig(buses=2, **options):
    bus = MemoryBus(buses, **options)
    return bus, MemoryReader(bus), BusMonitor(bus.health), signals.BusStatus("bus_status", {"bus": buses})


def test_buses_in_memory_report_bus_off_and_restart():
    bus, reader, monitor, record = rig()
    for classes, state in ((0x40, BusState.OFF), (0x100, BusState.UP)):
        bus.send(End.DEVICE, np.array([1], np.uint8), make_frames([CAN_ERR_FLAG | classes], 8), 0)
        reader.read(batch(), LATE)
        assert monitor.read(record, LATE)
        assert record.state.tolist() == [BusState.UP, state]
    assert record.errors.tolist() == [0, 2]


def test_buses_in_memory_report_what_they_have_no_room_for():
    bus, reader, monitor, record = rig(queue_capacity=3, receive_capacity=2)
    bus.send(End.HOST, np.array([1] * 5, np.uint8), make_frames([1] * 5, 8), 0)
    bus.send(End.DEVICE, np.array([0, 0, 0], np.uint8), make_frames([1] * 3, 8), 0)
    reader.read(batch(), LATE)
    assert monitor.read(record, LATE)
    assert record.refused.tolist() == [0, 2]
    assert record.overflow.tolist() == [1, 0]
    assert bus.lost(End.HOST) == 3


def test_buses_in_memory_report_a_backlog_while_it_lasts():
    bus, reader, monitor, record = rig()
    bus.send(End.DEVICE, np.array([1, 1, 1, 0, 0], np.uint8), make_frames([1, 1, 1, 7, 7], 8), 0)
    frames = batch(capacity=4)
    reader.read(frames, LATE)
    assert sorted(frames.bus[: frames.count].tolist()) == [0, 0, 1, 1], "each has its share"
    assert monitor.read(record, LATE)
    assert record.backlog.tolist() == [False, True]
    reader.read(frames, LATE + 1)
    assert frames.bus[: frames.count].tolist() == [1]
    assert monitor.read(record, LATE + 1)
    assert not record.backlog.any()


def test_what_has_not_arrived_yet_is_no_backlog():
    bus, reader, monitor, record = rig()
    bus.send(End.DEVICE, np.array([0] * 3, np.uint8), make_frames([1] * 3, 8), 0)
    reader.read(batch(capacity=4), 2 * 135_000)
    assert not monitor.read(record, 2 * 135_000)


def test_a_link_in_memory_that_is_down_carries_nothing_and_says_so():
    bus, reader, monitor, record = rig()
    both = np.array([0, 1], np.uint8)
    bus.send(End.DEVICE, both, make_frames([1, 2], 8), 0)
    bus.take_down(1)
    bus.send(End.HOST, both, make_frames([3, 4], 8), 0)
    bus.send(End.DEVICE, both, make_frames([5, 6], 8), np.zeros(2, np.int64))
    frames = batch()
    reader.read(frames, LATE)
    assert frames.bus[: frames.count].tolist() == [0, 0]
    assert bus.receive(End.DEVICE, LATE).frames["can_id"].tolist() == [3]
    assert monitor.read(record, LATE)
    assert record.state.tolist() == [BusState.UP, BusState.DOWN]
    assert (record.failed.tolist(), record.purged.tolist()) == ([0, 1], [0, 1])
    bus.bring_up(1)
    bus.send(End.DEVICE, both, make_frames([7, 8], 8), LATE)
    reader.read(frames, 2 * LATE)
    assert frames.bus[: frames.count].tolist() == [0, 1]
    assert monitor.read(record, 2 * LATE)
    assert not record.state.any()


# -- batches ----------------------------------------------------------------------------------------------------------


@given(st.lists(st.integers(0, 8), max_size=6))
def test_a_batch_holds_what_it_was_last_filled_with_and_zeros(counts):
    record = batch()
    for stamp, count in enumerate(counts, 1):
        before = record.count
        frames = make_frames(range(1, count + 1), 8).tobytes()
        assert fill(record, stamp, frames, [1] * count, [stamp] * count, 0) == bool(count or before)
        bus, data = content(record)
        assert (bus.tolist(), data.tobytes()) == ([1] * count, frames)
        assert not record.bus[count:].any()
        assert not record.arrival_ns[count:].any()
        assert not record.data[16 * count :].any()
