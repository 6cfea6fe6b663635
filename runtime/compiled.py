# SPDX-License-Identifier: Apache-2.0
"""Machine code for the numeric kernels of the control loops.

A tick is hundreds of operations on vectors of a few elements, each of which costs the interpreter more than the
processor. A compiled kernel is plain Python that numba translates once per machine and keeps in a cache; it allocates
little, calls nothing back, and divides by zero as IEEE 754 does, so that a bad number travels to the safety filter
instead of raising an exception in the loop. The translation neither reorders nor fuses floating-point operations: the
same numbers give the same bits in any process.

Kernels read and write records and configurations where they lie. From Python they are given as tables, structured
arrays of one row (`Record.table`, `table_of`); within kernels the row is passed on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import msgspec
import numba
import numpy as np

from runtime.kernel_cache import KernelCache

Config = TypeVar("Config", bound=msgspec.Struct)
Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays when it is first called with arguments of their types."""
    return _kernel(function, release_interpreter=False)


def compiled_long(function: Function) -> Function:
    """Compile a function that takes long, and let the threads of other loops compute meanwhile.

    Short ones keep the interpreter, since getting it back may take longer than they do.
    """
    return _kernel(function, release_interpreter=True)


def _kernel(function: Function, release_interpreter: bool) -> Function:
    kernel: Any = numba.njit(error_model="numpy", nogil=release_interpreter)(function)
    kernel._cache = KernelCache(function)  # type: ignore[no-untyped-call]
    return kernel


def table_of(config: Config) -> Sequence[Config]:
    """A configuration's numbers, flags and tuples of numbers, computed ones included, as a table (1,).

    What else it holds is left out.
    """
    computed = [name for name, value in vars(type(config)).items() if isinstance(value, property)]
    values = {name: getattr(config, name) for name in (*config.__struct_fields__, *computed)}
    numbers = {name: value for name, value in values.items() if _is_numeric(value)}
    layout = [(name, np.asarray(value).dtype, np.shape(value)) for name, value in numbers.items()]
    table: Any = np.array([tuple(numbers.values())], np.dtype(layout, align=True))
    return table


def _is_numeric(value: object) -> bool:
    return np.asarray(value).dtype.kind in "bif"
