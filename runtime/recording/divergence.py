# SPDX-License-Identifier: Apache-2.0
"""How a replayed value differs from the logged one: first by bits, else by how far each field moved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.records import Record


@dataclass(frozen=True)
class FieldDifference:
    """The first element in which two bodies of one layout differ."""

    field: str
    logged: Any
    replayed: Any

    def __str__(self) -> str:
        return f"{self.field} is {self.logged!r} in the log and {self.replayed!r} replayed"


@dataclass(frozen=True)
class Divergence:
    """Where a replay left the log.

    Attributes:
        task: that wrote the value, or whose state it is.
        loop: that stepped the task.
        step: index of the loop's tick.
        now_ns: time of the tick.
        signal: topic of the value.
        difference: the field, and both values.
    """

    task: str
    loop: str
    step: int
    now_ns: int
    signal: str
    difference: FieldDifference

    def __str__(self) -> str:
        return f"{self.task}, step {self.step} ({self.now_ns / 1e9:.3f} s): {self.signal}: {self.difference}"


@dataclass
class FieldShift:
    """How far one field of one signal moved between log and replay, over all steps."""

    signal: str
    field: str
    steps: int = 0
    elements: int = 0
    sum_of_squares: float = 0.0
    largest: float = 0.0
    largest_ns: int = 0

    @property
    def rms(self) -> float:
        """Root mean square over all elements and steps."""
        return math.sqrt(self.sum_of_squares / self.elements) if self.elements else 0.0

    def add(self, now_ns: int, logged: Any, replayed: Any) -> None:
        """Take one step into account; where exactly one of the two is not finite, the difference is infinite."""
        with np.errstate(invalid="ignore"):
            gap = np.abs(np.atleast_1d(replayed).astype(np.float64) - np.atleast_1d(logged).astype(np.float64))
        same = np.isnan(np.atleast_1d(logged).astype(float)) & np.isnan(np.atleast_1d(replayed).astype(float))
        gap = np.where(same, 0.0, np.where(np.isnan(gap), np.inf, gap))
        self.steps += 1
        self.elements += gap.size
        self.sum_of_squares += float(np.sum(gap * gap))
        largest = float(gap.max(initial=0.0))
        if largest > self.largest:
            self.largest, self.largest_ns = largest, now_ns


class Comparison:
    """Compares bodies of one record's layout.

    Args:
        record: whose layout it is.
        relative, absolute: tolerance for floating-point fields; both 0 for identity.
    """

    def __init__(self, record: Record, relative: float = 0.0, absolute: float = 0.0) -> None:
        self._logged, self._replayed = record.like(), record.like()
        self._relative, self._absolute = relative, absolute
        self.shifts = {f.name: FieldShift(record.topic, f.name) for f in record.fields}

    def first_difference(self, logged: bytes | memoryview, replayed: bytes) -> FieldDifference | None:
        """The first element that differs by more than the tolerance (without one: in any bit)."""
        if logged == replayed:
            return None
        self._logged.load(logged)
        self._replayed.load(replayed)
        for f in self._logged.fields:
            ours, theirs = np.atleast_1d(getattr(self._replayed, f.name)), np.atleast_1d(getattr(self._logged, f.name))
            for i in np.flatnonzero(self._differ(theirs, ours, f.kind.numpy)):
                name = f.name if f.length is None else f"{f.name}[{i}]"
                return FieldDifference(name, theirs[i].item(), ours[i].item())
        return None

    def _differ(self, logged: Any, replayed: Any, kind: str) -> Any:
        if kind == "<f8" and (self._relative or self._absolute):
            return ~np.isclose(replayed, logged, rtol=self._relative, atol=self._absolute, equal_nan=True)
        bits = [values.astype(kind).view("u1").reshape(-1, np.dtype(kind).itemsize) for values in (logged, replayed)]
        return np.any(bits[0] != bits[1], axis=1)

    def add_shifts(self, now_ns: int, logged: bytes | memoryview, replayed: bytes) -> None:
        """Take one step into account in `shifts`."""
        self._logged.load(logged)
        self._replayed.load(replayed)
        for name, shift in self.shifts.items():
            shift.add(now_ns, getattr(self._logged, name), getattr(self._replayed, name))
