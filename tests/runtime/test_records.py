# SPDX-License-Identifier: Apache-2.0
"""The memory of a record is the ROS 2 CDR body of the message with the same fields."""

import inspect

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from runtime import signals
from runtime.executors.tick import Tick
from runtime.records import (
    CDR_LITTLE_ENDIAN,
    Record,
    boolean,
    boolean_array,
    float64,
    float64_array,
    int64,
    uint8,
    uint8_array,
    uint32,
    uint32_array,
)
from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import assemble, sizes

CONFIG = load_configuration("uslgo1")
SIZES = {**sizes(CONFIG), "received": 3}
SIGNALS = [
    kind for _, kind in inspect.getmembers(signals, inspect.isclass) if issubclass(kind, Record) and kind is not Record
]
STATES = {
    type(item.task.state): item.task.state.sizes
    for loop in assemble(CONFIG).loops
    for item in loop.schedule
    if item.task.state is not None
}
ELEMENTS = {
    "float64": st.floats(width=64),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "uint8": st.integers(0, 255),
    "bool": st.booleans(),
}


class Crooked(Record):
    """Every alignment there is, with an odd end."""

    a = uint8()
    b = float64()
    c = boolean_array(3)
    d = uint32()
    e = uint8_array(5)
    f = int64()
    g = boolean()
    h = float64_array("joint")
    i = uint32_array(1)
    j = uint8()


def ros_type(record):
    """A type store that knows the record's message, and the name of that."""
    name = f"ugv_test_msgs/msg/{type(record).__name__}"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(record.ros_definition(), name))
    return store, name


@st.composite
def filled(draw, kind, lengths):
    """A record with any content at all, and the values that were put in."""
    record = kind("/test", lengths)
    values = {}
    for field in record.fields:
        elements = ELEMENTS[field.kind.ros]
        if field.length is None:
            values[field.name] = draw(elements)
        else:
            values[field.name] = draw(hnp.arrays(np.dtype(field.kind.numpy), field.count(lengths), elements=elements))
        setattr(record, field.name, values[field.name])
    return record, values


@pytest.mark.parametrize("kind", [*SIGNALS, Tick, Crooked, *STATES], ids=lambda kind: kind.__name__)
@settings(max_examples=12)
@given(data=st.data())
def test_bytes_are_what_a_ros_serialiser_writes(kind, data):
    record, values = data.draw(filled(kind, {**SIZES, **STATES.get(kind, {})}))
    store, name = ros_type(record)
    oracle = bytes(store.serialize_cdr(store.types[name](**values), name))
    assert CDR_LITTLE_ENDIAN + record.to_bytes() == oracle
    read = store.deserialize_cdr(oracle, name)
    for field in record.fields:
        np.testing.assert_array_equal(getattr(read, field.name), getattr(record, field.name))


@given(filled(Crooked, {"joint": 4}))
def test_loading_gives_back_every_value_and_padding_stays_zero(case):
    record, _ = case
    other = record.like()
    other.load(record.to_bytes())
    assert other.to_bytes() == record.to_bytes()
    body = np.frombuffer(record.to_bytes(), np.uint8)
    used = np.zeros(record.cdr_size, bool)
    for field in record.fields:
        offset = record.dtype.fields[field.name][1]
        used[offset : offset + np.dtype(field.kind.numpy).itemsize * field.count(record.sizes)] = True
    assert (~used).sum() == 7 + 1 + 3 + 7
    assert not body[~used].any()


def test_a_body_ends_with_its_last_field():
    record = Crooked("/test", {"joint": 4})
    assert record.cdr_size % 8 == 5
    assert len(record.to_bytes()) == record.cdr_size < record.dtype.itemsize


def test_assigning_copies():
    record = Crooked("/test", {"joint": 4})
    source = np.arange(4.0)
    view = record.h
    record.h = source
    source[:] = -1.0
    assert record.h.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert record.h is view
    view[2] = 7.0
    assert np.frombuffer(record.to_bytes(), "<f8", 4, record.dtype.fields["h"][1]).tolist() == [0.0, 1.0, 7.0, 3.0]
    record.h = 5.0
    assert record.h.tolist() == [5.0] * 4


def test_copies_share_nothing():
    record = Crooked("/test", {"joint": 4})
    record.h, record.a = 3.0, 9
    other = record.like("/other")
    assert (other.topic, other.a) == ("/other", 0)
    other.copy_from(record)
    record.clear()
    assert (other.a, other.h.tolist(), record.a, record.h.any()) == (9, [3.0] * 4, 0, False)


@given(st.binary(max_size=120))
def test_a_body_of_wrong_length_is_refused_and_changes_nothing(body):
    record = Crooked("/test", {"joint": 4})
    record.h = 2.0
    before = record.to_bytes()
    if len(body) == record.cdr_size:
        body += b"\0"
    with pytest.raises(ValueError, match=r"."):
        record.load(body)
    assert record.to_bytes() == before


@pytest.mark.parametrize("value", [-1, 256])
def test_a_number_that_does_not_fit_is_refused(value):
    record = Crooked("/test", {"joint": 4})
    with pytest.raises(ValueError, match=r"."):
        record.a = value


def test_an_array_of_wrong_length_is_refused():
    with pytest.raises(ValueError, match="broadcast"):
        Crooked("/test", {"joint": 4}).h = np.zeros(5)


def test_a_missing_size_is_named():
    with pytest.raises(KeyError, match="joint"):
        Crooked("/test", {})


def test_every_signal_of_the_robot_is_tested_here():
    written = {type(record) for loop in assemble(CONFIG).loops for record in (*loop.writes, *loop.port_inputs)}
    assert written <= set(SIGNALS)
