# SPDX-License-Identifier: Apache-2.0
"""The MIT-mode codec: physical values of n drives to 64-bit words and back, all drives at once.

Each field holds u = round((x - min) (2^n - 1) / (max - min)). A linear map from the caller's coordinates to the drive's
is folded into the same multiplication, so that a joint's direction, offset and gear cost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.dialects import COMMAND_FIELDS, REPLY_FIELDS, BitField, Dialect, Ranges
from drivers.errors import DriverConfigError, NonFiniteError

FloatArray = npt.NDArray[np.float64]
Words = npt.NDArray[np.uint64]
"""Data bytes as big-endian 64-bit words, one a drive; shorter data are followed by zeros."""

SPECIAL_PREFIX = b"\xff" * 7
ENABLE = SPECIAL_PREFIX + b"\xfc"
DISABLE = SPECIAL_PREFIX + b"\xfd"
SET_ZERO = SPECIAL_PREFIX + b"\xfe"
"""Makes the present position the drive's zero; never part of enabling."""

_SPECIALS = tuple(int.from_bytes(special, "big") for special in (ENABLE, DISABLE, SET_ZERO))
_ROUNDING_SLACK = 1e-6
"""Codes; far below one code and far above the rounding of the arithmetic."""


@dataclass(frozen=True)
class Transform:
    """A linear map, field by field: value at the drive = factor * value + shift.

    Attributes:
        factor: (fields, n), none zero.
        shift: (fields, n).
    """

    factor: FloatArray
    shift: FloatArray


class FieldCodec:
    """Packs some fields of n drives into words.

    Args:
        layout: the fields, most significant bit first.
        order: names that give the order of the rows; names that the layout lacks are left out.
        ranges: of each drive.
        transform: from the caller's coordinates; None for the drive's own.
        low, high: (fields, n) limits in the caller's coordinates, or None for the ranges alone.

    Attributes:
        rows: row of each field that is present.
        clipped: (fields,) how many values the last `encode` that clipped any did clip.
    """

    def __init__(
        self,
        layout: Sequence[BitField],
        order: Sequence[str],
        ranges: Sequence[Ranges],
        transform: Transform | None = None,
        low: FloatArray | None = None,
        high: FloatArray | None = None,
    ) -> None:
        placed = _place(layout)
        names = [name for name in order if name in placed]
        shape = (len(names), len(ranges))
        self.rows = {name: row for row, name in enumerate(names)}
        ends = np.array([[r.of(name, placed[name].bits) for r in ranges] for name in names]).reshape(*shape, 2)
        last = _spread([float((1 << placed[name].bits) - 1) for name in names], shape, np.float64)
        codes_per_unit = last / (ends[..., 1] - ends[..., 0])
        factor = np.ones(shape) if transform is None else transform.factor[: shape[0]]
        shift = np.zeros(shape) if transform is None else transform.shift[: shape[0]]
        self._scale, self._offset = factor * codes_per_unit, (shift - ends[..., 0]) * codes_per_unit
        self._unit, self._origin = (ends[..., 1] - ends[..., 0]) / last / factor, (ends[..., 0] - shift) / factor
        self._low, self._high = self._code_limits(low, high, last)
        self._shifts = _spread([placed[name].shift for name in names], shape, np.uint64)
        self._weights = np.array([1 << placed[name].shift for name in names], np.uint64)
        self._masks = _spread([(1 << placed[name].bits) - 1 for name in names], shape, np.uint64)
        self.clipped = np.zeros(shape[0], np.uint32)
        self._raw, self._codes, self._values = np.empty(shape), np.empty(shape), np.empty(shape)
        self._raw_in_turn = self._raw.reshape(-1)
        self._fields, self._packed = np.empty(shape, np.uint64), np.empty(shape[1], np.uint64)
        self._signed_fields = self._fields.view(np.int64)

    def _code_limits(
        self, low: FloatArray | None, high: FloatArray | None, last: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        first, final = np.full(last.shape, -_ROUNDING_SLACK), last + _ROUNDING_SLACK
        if low is None or high is None:
            return first, final
        one, other = low * self._scale + self._offset, high * self._scale + self._offset
        return np.clip(np.minimum(one, other), first, final), np.clip(np.maximum(one, other), first, final)

    def encode(self, values: Sequence[npt.ArrayLike] | FloatArray, out: Words) -> bool:
        """Encode one value of each field for each drive.

        Args:
            values: rows in the order given at construction, each (n,).
            out: (n,) words of any byte order, overwritten.

        Returns:
            Whether any value was clipped; only then `clipped` says how many of each field.

        Raises:
            NonFiniteError: if any value is NaN or infinite; `out` is then untouched.
        """
        raw, codes = self._raw, self._codes
        if isinstance(values, np.ndarray):
            np.multiply(values, self._scale, out=raw)
        else:
            np.concatenate(values, out=self._raw_in_turn)
            np.multiply(raw, self._scale, out=raw)
        np.add(raw, self._offset, out=raw)
        np.fmin(raw, self._high, out=codes)
        np.fmax(codes, self._low, out=codes)
        limited = codes.tobytes() != raw.tobytes()  # so are all that are not finite, since fmin prefers numbers to NaN
        if limited:
            self.clipped[:] = self._count_clipped(values)
        np.rint(codes, out=codes)
        np.copyto(self._signed_fields, codes, casting="unsafe")
        np.dot(self._weights, self._fields, out=self._packed)
        out[...] = self._packed
        return limited

    def decode(self, words: Words) -> FloatArray:
        """Values of each field (fields, n) of words (n,); the array is overwritten by the next call."""
        np.right_shift(words, self._shifts, out=self._fields)
        np.bitwise_and(self._fields, self._masks, out=self._fields)
        np.copyto(self._values, self._signed_fields)
        np.multiply(self._values, self._unit, out=self._values)
        np.add(self._values, self._origin, out=self._values)
        return self._values

    def _count_clipped(self, values: Sequence[npt.ArrayLike] | FloatArray) -> npt.NDArray[np.intp]:
        given = np.asarray(values, np.float64)
        if not np.isfinite(given).all():
            row, drive = np.argwhere(~np.isfinite(given))[0]
            name = list(self.rows)[row]
            raise NonFiniteError(f"{name} of drive {drive} is {given[row, drive]}; only finite values can be encoded")
        return np.count_nonzero(self._codes != self._raw, axis=1)


class MitCodec:
    """Both directions of one dialect for n drives.

    Args:
        dialect: of all drives.
        ranges: of each drive, or of all.
        count: number of drives, where `ranges` is one for all.
        transform: rows as `COMMAND_FIELDS`, from the caller's coordinates; applied to replies too.
        low, high: (5, n) limits on commands in the caller's coordinates.

    Attributes:
        commands: codec of commands, rows as `COMMAND_FIELDS`.
        replies: codec of replies, rows as `REPLY_FIELDS` as far as the dialect has them.
    """

    def __init__(
        self,
        dialect: Dialect,
        ranges: Ranges | Sequence[Ranges],
        count: int | None = None,
        transform: Transform | None = None,
        low: FloatArray | None = None,
        high: FloatArray | None = None,
    ) -> None:
        if isinstance(ranges, Ranges):
            if count is None:
                raise DriverConfigError("one Ranges for all drives needs their count")
            ranges = [ranges] * count
        self.dialect, self.count = dialect, len(ranges)
        self.commands = FieldCodec(dialect.command, COMMAND_FIELDS, ranges, transform, low, high)
        self.replies = FieldCodec(dialect.reply, REPLY_FIELDS, ranges, _reply_transform(transform, len(ranges)))

    def encode_commands(
        self,
        position: npt.ArrayLike,
        velocity: npt.ArrayLike,
        effort: npt.ArrayLike,
        stiffness: npt.ArrayLike,
        damping: npt.ArrayLike,
        out: Words,
    ) -> bool:
        """Encode one command a drive; see `FieldCodec.encode`.

        A command whose bytes would be those of a special frame (all fields at their largest code) has its last field
        lowered by at most three codes, and counts as clipped.
        """
        clipped = self.commands.encode((position, velocity, effort, stiffness, damping), out)
        if SPECIAL_PREFIX in out.tobytes():
            clipped = self._avoid_specials(out) or clipped
        return clipped

    def decode_commands(self, words: Words) -> FloatArray:
        """Commands (5, n), rows as `COMMAND_FIELDS`; the array is overwritten by the next call."""
        return self.commands.decode(words)

    def encode_replies(self, values: Sequence[npt.ArrayLike] | FloatArray, out: Words) -> bool:
        """Encode one reply a drive, rows as `replies.rows`; see `FieldCodec.encode`."""
        return self.replies.encode(values, out)

    def decode_replies(self, words: Words) -> FloatArray:
        """Replies, rows as `replies.rows`; the array is overwritten by the next call."""
        return self.replies.decode(words)

    def _avoid_specials(self, out: Words) -> bool:
        hit = np.isin(out, np.array(_SPECIALS, np.uint64))
        out[hit] = min(_SPECIALS) - 1
        self.commands.clipped[self.commands.rows[self.dialect.command[-1].name]] += np.count_nonzero(hit)
        return bool(hit.any())


@dataclass(frozen=True)
class _Placed:
    bits: int
    shift: int


def _place(layout: Sequence[BitField]) -> dict[str, _Placed]:
    placed, used = {}, 0
    for field in layout:
        used += field.bits
        placed[field.name] = _Placed(field.bits, 64 - used)
    return placed


def _spread(column: Sequence[float], shape: tuple[int, int], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """A column repeated for each drive: contiguous operands are faster than broadcast ones."""
    return np.repeat(np.array(column, dtype)[:, None], shape[1], axis=1)


def _reply_transform(transform: Transform | None, count: int) -> Transform | None:
    """The map of a command's first three rows, and none on the rows that only replies have."""
    if transform is None:
        return None
    factor, shift = np.ones((len(REPLY_FIELDS), count)), np.zeros((len(REPLY_FIELDS), count))
    factor[:3], shift[:3] = transform.factor[:3], transform.shift[:3]
    return Transform(factor, shift)
