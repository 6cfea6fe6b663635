# SPDX-License-Identifier: Apache-2.0
"""Fixed-layout records: the one form in which data is held, shared, logged and replayed.

A record class declares flat fields. An instance owns one zeroed buffer and prebuilt views of it. The layout is an
aligned little-endian numpy record; up to the end of its last field it is byte for byte the ROS 2 CDR body of a message
with the same fields, so control memory, log message and replay input are the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Encapsulation header that precedes every CDR body."""


class _Kind(NamedTuple):
    """One element type: its ROS name, its numpy format and its memoryview format."""

    ros: str
    numpy: str
    view: str


_FLOAT64 = _Kind("float64", "<f8", "d")
_INT64 = _Kind("int64", "<i8", "q")
_UINT32 = _Kind("uint32", "<u4", "I")
_UINT8 = _Kind("uint8", "u1", "B")
_BOOL = _Kind("bool", "?", "?")

AnyRecord = TypeVar("AnyRecord", bound="Record")
Element = TypeVar("Element", bound=np.generic)


_NOWHERE: dict[str, tuple[Any, int | slice]] = {}


class Field:
    """A named part of a record; reading gives a number or an array view, assigning copies into the buffer."""

    def __init__(self, kind: _Kind, length: int | str | None, unit: str, doc: str) -> None:
        self.kind, self.length, self.unit, self.doc = kind, length, unit, doc
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, record: Record | None, owner: type | None = None) -> Any:
        # reached for scalars only: an instance holds the views of its arrays under their own names
        return self if record is None else record._places[self.name][0][0]

    def count(self, sizes: Mapping[str, int]) -> int:
        """Number of elements, with symbolic lengths looked up in `sizes`."""
        if self.length is None:
            return 1
        return sizes[self.length] if isinstance(self.length, str) else self.length

    def ros_line(self, sizes: Mapping[str, int]) -> str:
        """The field as one line of a ROS message definition."""
        extent = "" if self.length is None else f"[{self.count(sizes)}]"
        note = ", ".join(part for part in (self.unit, self.doc) if part)
        return f"{self.kind.ros}{extent} {self.name}" + (f"  # {note}" if note else "")


if TYPE_CHECKING:
    from typing_extensions import Self

    class ArrayField(Generic[Element]):
        """How an array field looks to a type checker: reading gives a view, anything array-like can be assigned."""

        def __get__(self, record: Record, owner: type | None = None) -> npt.NDArray[Element]:
            """The view."""

        def __set__(self, record: Record, value: npt.ArrayLike) -> None:
            """Copy into the view."""


def float64(unit: str = "", doc: str = "") -> float:
    """Declare a scalar float64 field."""
    return Field(_FLOAT64, None, unit, doc)  # type: ignore[return-value]


def int64(unit: str = "", doc: str = "") -> int:
    """Declare a scalar int64 field."""
    return Field(_INT64, None, unit, doc)  # type: ignore[return-value]


def uint32(unit: str = "", doc: str = "") -> int:
    """Declare a scalar uint32 field."""
    return Field(_UINT32, None, unit, doc)  # type: ignore[return-value]


def uint8(unit: str = "", doc: str = "") -> int:
    """Declare a scalar uint8 field."""
    return Field(_UINT8, None, unit, doc)  # type: ignore[return-value]


def boolean(doc: str = "") -> bool:
    """Declare a scalar bool field."""
    return Field(_BOOL, None, "", doc)  # type: ignore[return-value]


def float64_array(length: int | str, unit: str = "", doc: str = "") -> ArrayField[np.float64]:
    """Declare an array of float64, its length a number or the name of one of the robot's sizes."""
    return Field(_FLOAT64, length, unit, doc)  # type: ignore[return-value]


def int64_array(length: int | str, unit: str = "", doc: str = "") -> ArrayField[np.int64]:
    """Declare an array of int64."""
    return Field(_INT64, length, unit, doc)  # type: ignore[return-value]


def uint32_array(length: int | str, unit: str = "", doc: str = "") -> ArrayField[np.uint32]:
    """Declare an array of uint32."""
    return Field(_UINT32, length, unit, doc)  # type: ignore[return-value]


def uint8_array(length: int | str, unit: str = "", doc: str = "") -> ArrayField[np.uint8]:
    """Declare an array of uint8."""
    return Field(_UINT8, length, unit, doc)  # type: ignore[return-value]


def boolean_array(length: int | str, doc: str = "") -> ArrayField[np.bool_]:
    """Declare an array of bool."""
    return Field(_BOOL, length, "", doc)  # type: ignore[return-value]


class Record:
    """A buffer with named, typed parts.

    Args:
        topic: the name under which the record is shared and logged.
        sizes: the robot's sizes (`{"joint": 12, "foot": 4}`) that symbolic lengths refer to.

    Attributes:
        topic: as given.
        dtype: aligned little-endian numpy record type.
        cdr_size: bytes up to the end of the last field, which is the length of the CDR body.
        table: the same memory as a structured array (1,), the form in which compiled kernels take a record.
        on_change: class attribute; true for records that are logged only when their bytes changed.
    """

    fields: ClassVar[tuple[Field, ...]] = ()
    on_change: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        declared = tuple(value for value in vars(cls).values() if isinstance(value, Field))
        inherited = tuple(field for base in cls.__bases__ for field in getattr(base, "fields", ()))
        cls.fields = inherited + declared

    def __init__(self, topic: str, sizes: Mapping[str, int] | None = None) -> None:
        self.topic = topic
        self.sizes = dict(sizes or {})
        self.dtype = np.dtype(
            [
                (f.name, f.kind.numpy) if f.length is None else (f.name, f.kind.numpy, (f.count(self.sizes),))
                for f in self.fields
            ],
            align=True,
        )
        offsets = [int(self.dtype.fields[f.name][1]) for f in self.fields]  # type: ignore[index]
        ends = [
            offset + f.count(self.sizes) * np.dtype(f.kind.numpy).itemsize
            for f, offset in zip(self.fields, offsets, strict=True)
        ]
        self.cdr_size = ends[-1]
        self._places: dict[str, tuple[Any, int | slice]] = {}
        self._buffer = bytearray(self.dtype.itemsize)
        self._body = memoryview(self._buffer)[: self.cdr_size]
        self.table: Sequence[Self] = self._table()
        for f, offset, end in zip(self.fields, offsets, ends, strict=True):
            window = memoryview(self._buffer)[offset:end]
            if f.length is None:
                self._places[f.name] = window.cast(f.kind.view), 0  # type: ignore[call-overload]
            else:
                view = np.frombuffer(window, dtype=f.kind.numpy)
                self.__dict__[f.name] = view
                self._places[f.name] = view, slice(None)

    def __setattr__(self, name: str, value: Any) -> None:
        place = self.__dict__.get("_places", _NOWHERE).get(name)
        if place is None:
            object.__setattr__(self, name, value)
        else:
            view, where = place
            view[where] = value

    def _table(self) -> Any:
        """Flags in arrays become bytes, since compiled code knows no arrays of flags within records."""
        parts = [
            (f.name, f.kind.numpy if f.length is None or f.kind is not _BOOL else "u1", self.dtype[f.name].shape)
            for f in self.fields
        ]
        return np.frombuffer(self._buffer, np.dtype(parts, align=True))

    def to_bytes(self) -> bytes:
        """The CDR body: every field, without trailing padding."""
        return bytes(self._body)

    def load(self, body: bytes | memoryview) -> None:
        """Overwrite every field.

        Raises:
            ValueError: if `body` is not exactly `cdr_size` bytes.
        """
        self._body[:] = body

    def copy_from(self, other: Record) -> None:
        """Overwrite every field with those of a record of the same layout."""
        self._body[:] = other._body

    def clear(self) -> None:
        """Set every field to zero."""
        self._body[:] = bytes(self.cdr_size)

    def like(self: AnyRecord, topic: str | None = None) -> AnyRecord:
        """A new zeroed record of the same layout."""
        return type(self)(self.topic if topic is None else topic, self.sizes)

    def ros_definition(self) -> str:
        """The ROS 2 message definition of this layout."""
        return "".join(f.ros_line(self.sizes) + "\n" for f in self.fields)
