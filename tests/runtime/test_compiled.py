# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels do what the Python they stand for does, on records and configurations where they lie."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.compiled import compiled, table_of
from runtime.records import Record, boolean, boolean_array, float64, float64_array, uint32
from runtime.robots import load_configuration


class Inner(msgspec.Struct, frozen=True):
    depth: float = 1.0


class Settings(msgspec.Struct, frozen=True):
    """One of everything that configurations hold."""

    name: str = "any"
    gain: float = 0.25
    period_ns: int = 2**53 + 1
    on: bool = True
    weights: tuple[float, float, float] = (1.0, 2.0, 3.0)
    inner: Inner = Inner()

    @property
    def twice(self) -> float:
        """A computed number."""
        return 2.0 * self.gain


class Memory(Record):
    """One of everything that kernels change."""

    started = boolean()
    count = uint32()
    level = float64()
    values = float64_array("size")
    flags = boolean_array("size")


@compiled
def work(settings, memories, step):
    setting, memory = settings[0], memories[0]
    memory.started = setting.on
    memory.count += step
    memory.level = setting.twice / setting.weights[2]
    memory.values[:] = memory.values * setting.gain + setting.weights[1]
    memory.flags[:] = memory.values > 2.2
    return setting.period_ns


def test_kernels_read_configurations_and_write_records_where_they_lie():
    memory = Memory("/memory", {"size": 3})
    memory.values, memory.count = (0.0, 1.0, 2.0), 2**32 - 2
    assert work(table_of(Settings()), memory.table, 1) == 2**53 + 1
    assert (memory.started, memory.count) == (True, 2**32 - 1)
    assert memory.level == 0.5 / 3.0
    assert memory.values.tolist() == [2.0, 2.25, 2.5]
    assert memory.flags.tolist() == [False, True, True]


def test_what_is_no_number_is_left_out_of_a_table():
    assert set(table_of(Settings()).dtype.names) == {"gain", "period_ns", "on", "weights", "twice"}


def test_a_table_is_the_records_own_memory():
    memory = Memory("/memory", {"size": 2})
    memory.table[0]["values"][1] = 7.0
    assert memory.values[1] == 7.0
    assert memory.table[0].nbytes == memory.dtype.itemsize
    assert [memory.table.dtype.fields[name][1] for name in memory.dtype.names] == [
        memory.dtype.fields[name][1] for name in memory.dtype.names
    ]


def test_every_part_of_the_robots_configuration_has_a_table():
    config = load_configuration("uslgo1")
    for part in (config.gait, config.kalman, config.safety, config.whole_body, config.mpc, config.quadruped):
        row = table_of(part)[0]
        for name in row.dtype.names:
            np.testing.assert_array_equal(row[name], getattr(part, name))


@compiled
def ratio_and_root(a, b):
    return a / b, math.sqrt(a), min(a, b)


@pytest.mark.parametrize(("a", "b", "expected"), [(1.0, 0.0, math.inf), (0.0, 0.0, math.nan), (-1.0, 0.0, -math.inf)])
def test_bad_numbers_travel_on_instead_of_raising(a, b, expected):
    ratio, root, _ = ratio_and_root(a, b)
    np.testing.assert_equal(ratio, expected)
    assert math.isnan(root) == (a < 0.0)


@compiled
def polynomial(x, coefficients):
    value = 0.0
    for coefficient in coefficients:
        value = value * x + coefficient
    return value


@given(st.floats(-1e3, 1e3), st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=8))
def test_operations_are_neither_reordered_nor_fused(x, coefficients):
    """The interpreter rounds after every operation, and so does the kernel."""
    array = np.array(coefficients)
    assert polynomial(x, array) == polynomial.py_func(float(x), coefficients)
